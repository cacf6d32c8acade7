"""Events merged by pixel, and counted around nodes in patches and around events in log-polar bins (log_polar.cpp)."""

from __future__ import annotations

import numpy as np

from nvsdata.kernels import _native


def merged_pixels(
    t: np.ndarray, x: np.ndarray, y: np.ndarray, p: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Merge the events of each pixel into one node; sort the nodes by the mean times of their events.

    Returns x and y of the nodes, float32 [M, 2]; their mean times, rounded down, int64 [M]; their first and last times,
    int64 [M, 2]; and their numbers of events of polarity 1 and of polarity 0, float32 [M, 2]. O(N + M log M).
    """
    pos, time = np.empty((t.size, 2), np.float32), np.empty(t.size, np.int64)
    ends, counts = np.empty((t.size, 2), np.int64), np.empty((t.size, 2), np.float32)
    nodes = _native.merged_pixels(t, x, y, p, pos, time, ends, counts)
    return pos[:nodes], time[:nodes], ends[:nodes], counts[:nodes]


def patch_counts(x: np.ndarray, y: np.ndarray, p: np.ndarray, pos: np.ndarray, size: int) -> np.ndarray:
    """Return the numbers of events at each pixel of the patch around each node, float32 [N, 2, size, size].

    Polarity 1 comes before 0. `x`, `y` and `p` are those of all events, and `pos` float32 [N, 2] has the positions of
    the nodes. `size` must be odd. O(events + N size²).
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
    """Write a histogram of the recent events around each event, with a sum of 1, to `out` float32 [N, bins].

    The queue has the `queue` latest events up to the event, including it. `dx` and `dy` int64 [M] are offsets from the
    event, and `weights` float32 [M, bins] the amounts that an event at this offset adds to each bin. `count` int32 [H +
    2 r, W + 2 r], where r is the largest offset, is scratch memory and must be 0. O(N M (bins of an offset)). Events
    outside the sensor raise an IndexError.
    """
    _native.around_events(x, y, queue, dx, dy, weights, count, out)
