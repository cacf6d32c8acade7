"""Metrics: distances between emulated and real events, similarities of feature vectors, accuracy of classifiers."""

from nvsdata.metrics.classification import (
    Calibration,
    accuracy_by_votes,
    calibration,
    class_accuracies,
    confusion_matrix,
    predictions,
)
from nvsdata.metrics.distance import (
    Comparison,
    Distance,
    chamfer,
    compare,
    emd,
    epsilon_repeatability,
    score,
)
from nvsdata.metrics.intervals import Accuracy, PairedTest, accuracy, paired_test
from nvsdata.metrics.similarity import area_under_roc, roc, similarities

__all__ = [
    "Accuracy",
    "Calibration",
    "Comparison",
    "Distance",
    "PairedTest",
    "accuracy",
    "accuracy_by_votes",
    "area_under_roc",
    "calibration",
    "chamfer",
    "class_accuracies",
    "compare",
    "confusion_matrix",
    "emd",
    "epsilon_repeatability",
    "paired_test",
    "predictions",
    "roc",
    "score",
    "similarities",
]
