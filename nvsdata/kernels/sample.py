"""Non-uniform grid sampling."""

from __future__ import annotations

import numpy as np

from nvsdata.kernels.compiling import njit
from nvsdata.kernels.random import STEP, random_bits

BUCKETS = 256  # in the histogram that finds a median


@njit
def nonuniform_sample(t, x, y, k, wx, wt, seed):
    """Indices (sorted, int64) of one random event from each box of at most `k` events.

    The space-time box of all events is split at the median of its widest side (x and y weighted
    by `wx`, t by `wt`; ties by index) until a box holds at most k events. `t` must not decrease.
    O(N log(N / k)).
    """
    n = t.size
    # every box keeps its events in order of time, so that a split in time costs nothing
    index, columns = np.empty(n, np.int32), np.empty((2, n), np.int16)
    # loops here and below: numba takes seconds to compile assignments between arrays
    for i in range(n):
        index[i], columns[0, i], columns[1, i] = i, x[i], y[i]
    spare = np.empty((3, n), np.int32)
    counts = np.empty(BUCKETS, np.int32)
    chosen = np.zeros(n, np.bool_)
    # an explicit stack: each split halves the box, so it never gets deeper than 64
    lows = np.empty(128, np.int64)
    highs = np.empty(128, np.int64)
    lows[0], highs[0] = 0, n
    depth = 1 if n else 0
    state = np.uint64(seed)
    while depth:
        depth -= 1
        lo, hi = lows[depth], highs[depth]
        if hi - lo <= k:
            state, pick = _below(state, hi - lo)
            chosen[index[lo + pick]] = True
            continue
        x0, x1 = _range(columns[0], lo, hi)
        y0, y1 = _range(columns[1], lo, hi)
        side_x, side_y = np.int64(x1 - x0) * wx, np.int64(y1 - y0) * wx
        side_t = np.float64(t[index[hi - 1]] - t[index[lo]]) * wt
        middle = (lo + hi) // 2
        if side_t < side_x or side_t < side_y:
            axis = 0 if side_x >= side_y else 1
            first, last = (x0, x1) if axis == 0 else (y0, y1)
            border, equal = _median(columns[axis], lo, hi, first, last, middle - lo, counts)
            _partition(index, columns, spare, lo, hi, axis, border, equal)
        lows[depth], highs[depth] = middle, hi
        lows[depth + 1], highs[depth + 1] = lo, middle
        depth += 2
    return np.flatnonzero(chosen)


@njit
def _below(state, bound):
    """Next state of a generator and a number in [0, bound)."""
    state += np.uint64(STEP)
    # the upper 32 bits, scaled: negligible bias for boxes below 2^20 events
    return state, np.int64(((random_bits(state) >> np.uint64(32)) * np.uint64(bound)) >> np.uint64(32))


@njit
def _range(values, lo, hi):
    """Least and greatest of values[lo:hi]."""
    least = most = values[lo]
    for i in range(np.uint64(lo), np.uint64(hi)):
        least, most = min(least, values[i]), max(most, values[i])
    return least, most


@njit
def _median(values, lo, hi, first, last, nth, counts):
    """The `nth` smallest of values[lo:hi], which lie in first..last, and how many equal to it come before it."""
    shift = 0
    while (np.int64(last) - first) >> shift >= BUCKETS:
        shift += 1
    before = 0
    while True:
        counts[: ((last - first) >> shift) + 1] = 0
        for value in values[lo:hi]:
            # a value below `first` wraps to a large number; one above `last` is never looked at
            at = np.uint32(np.int32(value) - np.int32(first)) >> np.uint32(shift)
            if at < BUCKETS:
                counts[np.uint64(at)] += 1
        bucket = 0
        while before + counts[bucket] <= nth:
            before += counts[bucket]
            bucket += 1
        first += bucket << shift
        if shift == 0:
            return first, nth - before
        last = min(last, first + (1 << shift) - 1)
        shift = 0


@njit
def _partition(index, columns, spare, lo, hi, axis, border, equal):
    """Move events below `border` on `axis`, and the first `equal` events at it, to the front, stably."""
    # unsigned indices spare numba's test for negative ones
    left, right = np.uint64(lo), np.uint64(0)
    values = columns[axis]
    for i in range(np.uint64(lo), np.uint64(hi)):
        value = values[i]
        tie = (value == border) & (equal > 0)
        equal -= tie
        near = (value < border) | tie
        event, column, row = index[i], columns[0, i], columns[1, i]
        # no branch: both places are written, and only the counts depend on the comparison
        spare[0, right], spare[1, right], spare[2, right] = event, column, row
        index[left], columns[0, left], columns[1, left] = event, column, row
        left += np.uint64(near)
        right += np.uint64(not near)
    for i in range(right):
        index[left + i] = spare[0, i]
        columns[0, left + i], columns[1, left + i] = spare[1, i], spare[2, i]
