"""How far emulated events are from real ones (thesis 3.3)."""

from nvsdata.metrics.distance import (
    Comparison,
    Distance,
    chamfer,
    compare,
    emd,
    epsilon_repeatability,
)
from nvsdata.metrics.score import score

__all__ = ["Comparison", "Distance", "chamfer", "compare", "emd", "epsilon_repeatability", "score"]
