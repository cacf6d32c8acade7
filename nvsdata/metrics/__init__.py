"""Distances between emulated and real events (thesis 3.3), and similarities of two feature vectors (5.3.2)."""

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
    "Comparison",
    "Distance",
    "area_under_roc",
    "chamfer",
    "compare",
    "emd",
    "epsilon_repeatability",
    "roc",
    "score",
    "similarities",
]
