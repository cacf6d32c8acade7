"""Which events pass a filter."""

from __future__ import annotations

import numpy as np

from nvsdata.kernels.compiling import njit

NEVER = np.int64(-(2**63))  # more than 2^62 µs before all events


@njit
def after_pause(t, x, y, size, period):
    """Mask of the events at least `period` µs after the last one of their pixel that passed. O(N + pixels).

    `period` is at most 2^62.
    """
    last, keep = np.full((size[1], size[0]), NEVER), np.empty(t.size, np.bool_)
    for i in range(np.uint64(t.size)):
        row, column = np.uint64(y[i]), np.uint64(x[i])
        keep[i] = last[row, column] <= t[i] - period
        if keep[i]:
            last[row, column] = t[i]
    return keep


@njit
def in_company(t, x, y, size, window):
    """Mask of the events up to `window` µs, at most 2^62, after one of the eight pixels around. O(N + pixels)."""
    # a border of one pixel, so that none is outside
    last, keep = np.full((size[1] + 2, size[0] + 2), NEVER), np.empty(t.size, np.bool_)
    one, two = np.uint64(1), np.uint64(2)
    for i in range(np.uint64(t.size)):
        row, column = np.uint64(y[i]), np.uint64(x[i])
        above = max(last[row, column], last[row, column + one], last[row, column + two])
        beside = max(last[row + one, column], last[row + one, column + two])
        below = max(last[row + two, column], last[row + two, column + one], last[row + two, column + two])
        keep[i] = max(above, beside, below) >= t[i] - window
        last[row + one, column + one] = t[i]
    return keep


@njit
def counts(x, y, size):
    """Number of events of each pixel: int64 [H, W]."""
    out = np.zeros((size[1], size[0]), np.int64)
    for i in range(np.uint64(x.size)):
        out[np.uint64(y[i]), np.uint64(x[i])] += 1
    return out


@njit
def in_rectangle(x, y, left, top, width, height):
    """Mask of the events of a rectangle of pixels. O(N)."""
    inside = np.empty(x.size, np.bool_)
    for i in range(np.uint64(x.size)):
        inside[i] = (0 <= x[i] - left < width) & (0 <= y[i] - top < height)
    return inside
