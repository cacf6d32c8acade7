"""Events merged by pixel, and counted around nodes in patches and around events in log-polar bins (log_polar.cpp)."""

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


def around_events(
    x: np.ndarray,
    y: np.ndarray,
    queue: int,
    dx: np.ndarray,
    dy: np.ndarray,
    weights: np.ndarray,
    count: np.ndarray,
    out: np.ndarray,
) -> None:
    """Put the weighted numbers of the events in the queue around each event into `out` float32 [N, bins], of sum 1.

    The queue has the `queue` latest events up to the event, itself included. `dx`, `dy` int64 [M] are offsets, and
    `weights` float32 [M, bins] what an event there adds; `count` int32 [H + 2 r, W + 2 r], r being the largest
    offset, is scratch, 0. O(N M), and the bins that an offset reaches. IndexError for events outside the sensor.
    """
    _native.around_events(x, y, queue, dx, dy, weights, count, out)
