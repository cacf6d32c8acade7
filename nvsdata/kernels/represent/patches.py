"""Events of pixels: merged into nodes, and counted around nodes."""

from __future__ import annotations

import numpy as np

from nvsdata.kernels import _native


def merged_pixels(
    t: np.ndarray, x: np.ndarray, y: np.ndarray, p: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Merge the events of each pixel to one node, in order of their mean times.

    Returns the nodes' x and y float32 [M, 2], the mean of their times rounded down int64 [M], their first and last
    times int64 [M, 2], and how many events of polarity 1 and of polarity 0 each has, float32 [M, 2]. O(N + M log M).
    """
    pos, time = np.empty((t.size, 2), np.float32), np.empty(t.size, np.int64)
    ends, counts = np.empty((t.size, 2), np.int64), np.empty((t.size, 2), np.float32)
    nodes = _native.merged_pixels(t, x, y, p, pos, time, ends, counts)
    return pos[:nodes], time[:nodes], ends[:nodes], counts[:nodes]


def patch_counts(x: np.ndarray, y: np.ndarray, p: np.ndarray, pos: np.ndarray, size: int) -> np.ndarray:
    """Return events by pixel of the patch around each node: float32 [N, 2, size, size], polarity 1 and then 0.

    `x`, `y`, `p` are those of all events, `pos` float32 [N, 2] of the nodes; `size` is odd. O(events + N size²).
    """
    out = np.zeros((len(pos), 2, size, size), np.float32)
    _native.patch_counts(x, y, p, pos, out)
    return out
