"""Measures of each pixel's events, and sums in patches of pixels."""

from __future__ import annotations

import numpy as np

from nvsdata.kernels.compiling import njit

COUNT, POLARITY, TIME = 0, 1, 2
SUM, MEAN, MAX, VARIANCE = 0, 1, 2, 3


@njit
def measured(t, x, y, p, start, span, first, last, wanted, quantity, measure, scratch, out):
    """Put a measure of each pixel's events from `first` to `last` into `out` float32 [H, W], 0 without events. O(N).

    `wanted`: their polarity, -1 for any. `quantity`: 1, ±1 or the time from `start` as a share of `span`. `scratch`
    is float64 [3, H, W].
    """
    scratch[:] = 0
    number, total, squares = scratch[0], scratch[1], scratch[2]
    for i in range(np.uint64(first), np.uint64(last)):
        if wanted >= 0 and p[i] != wanted:
            continue
        row, column = np.uint64(y[i]), np.uint64(x[i])
        value = 1.0
        if quantity == POLARITY:
            value = np.float64(2) * p[i] - 1
        elif quantity == TIME:
            value = np.float64(t[i] - start) / span if span else 0.0
        number[row, column] += 1
        squares[row, column] += value * value
        if measure == MAX:
            total[row, column] = max(total[row, column], value)
        else:
            total[row, column] += value
    share, results = number.ravel(), out.ravel()
    sums, powers = total.ravel(), squares.ravel()
    for q in range(np.uint64(share.size)):
        mean = sums[q] / max(share[q], 1.0)
        if measure == VARIANCE:
            results[q] = max(powers[q] / max(share[q], 1.0) - mean * mean, 0.0)
        else:
            results[q] = mean if measure == MEAN else sums[q]


@njit
def tokens(t, x, y, p, bounds, patch, out):
    """Add events to `out` [K, 2, 2, patch², H', W']: their number, and the sum of their times from 0 to 1. O(N).

    Axes: part of the time, from `bounds[part]` to `bounds[part + 1]`, polarity (OFF first), which of both, place in the
    patch, patch.
    """
    start, side = t[0], np.uint64(patch)
    scale = 1 / np.float64(max(t[t.size - 1] - start, 1))
    for part in range(bounds.size - 1):
        frame = out[part]
        for i in range(np.uint64(bounds[part]), np.uint64(bounds[part + 1])):
            row, column, channel = np.uint64(y[i]), np.uint64(x[i]), np.uint64(p[i])
            across, down = column // side, row // side
            place = (row - down * side) * side + column - across * side
            frame[channel, 0, place, down, across] += np.float32(1)
            frame[channel, 1, place, down, across] += np.float32(np.float64(t[i] - start) * scale)
