"""Distances between emulated and real events (thesis 3.3), similarities of two feature vectors (5.3.2), accuracy."""

from nvsdata.metrics.classification import (
    Calibration,
    accuracy_by_votes,
    calibration,
    class_accuracies,
    confusion_matrix,
    verdicts,
)
from nvsdata.metrics.distance import (
    Comparison,
    Distance,
    chamfer,
    compare,
    emd,
    epsilon_repeatability,
)
from nvsdata.metrics.scoring import score
from nvsdata.metrics.similarity import area_under_roc, roc, similarities

__all__ = [
    "Calibration",
    "Comparison",
    "Distance",
    "accuracy_by_votes",
    "area_under_roc",
    "calibration",
    "chamfer",
    "class_accuracies",
    "compare",
    "confusion_matrix",
    "emd",
    "epsilon_repeatability",
    "roc",
    "score",
    "similarities",
    "verdicts",
]
