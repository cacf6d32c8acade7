"""Events of pixels: merged into nodes, and counted around nodes."""

from __future__ import annotations

import numpy as np

from nvsdata.kernels.compiling import njit
from nvsdata.kernels.pixels import PAD, SIDE, by_pixel


@njit
def merged_pixels(t, x, y, p):
    """The events of each pixel as one node, in order of their mean times.

    Returns the nodes' x and y float32 [M, 2], the mean of their times rounded down int64 [M], their first and last
    times int64 [M, 2], and how many events of polarity 1 and of polarity 0 each has, float32 [M, 2]. O(N + M log M).
    """
    order, first, _, _, _ = by_pixel(x, y)
    pixels = first.size - 1
    mean = np.empty(pixels, np.int64)
    for q in range(pixels):
        # from the first time on, because a sum of absolute times may be too large
        begin, total = t[order[first[q]]], np.int64(0)
        for e in range(first[q], first[q + 1]):
            total += t[order[e]] - begin
        mean[q] = begin + total // (first[q + 1] - first[q])
    # of equal means the pixel that fired first
    by_time = np.argsort(order[first[:-1]])
    by_time = by_time[np.argsort(mean[by_time], kind="mergesort")]
    pos, time = np.empty((pixels, 2), np.float32), np.empty(pixels, np.int64)
    ends, counts = np.empty((pixels, 2), np.int64), np.zeros((pixels, 2), np.float32)
    for node in range(pixels):
        q = by_time[node]
        a, b = order[first[q]], order[first[q + 1] - 1]
        pos[node, 0], pos[node, 1], time[node] = x[a], y[a], mean[q]
        ends[node, 0], ends[node, 1] = t[a], t[b]
        for e in range(first[q], first[q + 1]):
            counts[node, 0 if p[order[e]] else 1] += 1
    return pos, time, ends, counts


@njit
def patch_counts(x, y, p, pos, size):
    """Events by pixel of the patch around each node: float32 [N, 2, size, size], polarity 1 and then 0.

    `x`, `y`, `p` are those of all events, `pos` float [N, 2] of the nodes; `size` is odd, at most 17. O(events
    + N size²).
    """
    order, first, _, tiles, blocks = by_pixel(x, y)
    counts = np.zeros((first.size - 1, 2), np.float32)
    for q in range(first.size - 1):
        for e in range(first[q], first[q + 1]):
            counts[q, 0 if p[order[e]] else 1] += 1
    out = np.zeros((len(pos), 2, size, size), np.float32)
    if x.size == 0:
        return out
    x0, y0, half = np.int64(x.min()), np.int64(y.min()), size // 2
    rows, columns = tiles.shape[0] * SIDE, tiles.shape[1] * SIDE
    for node in range(len(pos)):
        left = np.int64(np.floor(pos[node, 0] + 0.5)) - x0 + PAD - half
        top = np.int64(np.floor(pos[node, 1] + 0.5)) - y0 + PAD - half
        for b in range(size):
            for a in range(size):
                row, column = top + b, left + a
                if not (0 <= row < rows and 0 <= column < columns):
                    continue
                q = blocks[tiles[row // SIDE, column // SIDE], (row % SIDE) * SIDE + column % SIDE]
                if q >= 0:
                    out[node, 0, b, a], out[node, 1, b, a] = counts[q, 0], counts[q, 1]
    return out
