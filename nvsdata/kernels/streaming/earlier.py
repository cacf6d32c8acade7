"""The nearest earlier events of each event."""

from __future__ import annotations

import numpy as np

from nvsdata.kernels import _native

FEW = 64  # number of neighbors for which memory is allocated at first


def earlier_edges(
    t: np.ndarray,
    x: np.ndarray,
    y: np.ndarray,
    sensor_size: tuple[int, int],
    metric: tuple[float, float, float],
    k: int,
) -> np.ndarray:
    """Return edges to each event from the `k` nearest earlier events: int64 [2, E], sorted by (target, source).

    O(N (pixels up to the farthest neighbor) k).

    Args:
        t: Times in µs, int64 [N], which must not decrease.
        x: Columns, int32 [N].
        y: Rows, int32 [N].
        sensor_size: Width and height of the sensor in pixels.
        metric: radius, alpha and beta as in `near_sources`; alpha must be above 0.
        k: Largest number of neighbors, at least 1.

    Raises:
        ValueError: Columns have different lengths, or an event is outside the sensor.
    """
    most, few = min(k, max(t.size, 1)), FEW
    while True:
        # memory for the actual number of neighbors, not for the largest possible one
        degree, source = np.empty(t.size, np.int32), np.empty((t.size, min(few, most)), np.int32)
        count = _native.earlier_sources(t, x, y, *sensor_size, *metric, degree, source)
        if few >= most or degree.max() < few:
            break
        few *= 4
    edges = np.empty((2, count), np.int64)
    _native.listed_edges(degree, source, edges)
    return edges
