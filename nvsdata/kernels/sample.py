"""Non-uniform grid sampling."""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True, nogil=True)
def nonuniform_sample(t, x, y, k, wx, wt, seed):
    """Indices (sorted, int64) of one random event from each box of at most `k` events.

    The space-time box of all events is split at the median of its widest side (x and y weighted
    by `wx`, t by `wt`) until a box holds at most k events. Expected O(N log(N / k)).
    """
    n = t.size
    # a key and its index in one number: the median of unique numbers needs no tie-break
    index_bits = 1
    while n >> index_bits:
        index_bits += 1
    mask = np.int64((1 << index_bits) - 1)
    packed = np.arange(n)
    chosen = np.empty(n, np.int64)
    kept = 0
    # an explicit stack: each split halves the box, so it never gets deeper than 64
    lows = np.empty(128, np.int64)
    highs = np.empty(128, np.int64)
    depth = 0
    if n:
        lows[0], highs[0], depth = 0, n, 1
    state = np.uint64(seed)
    while depth:
        depth -= 1
        lo, hi = lows[depth], highs[depth]
        if hi - lo <= k:
            state, pick = _below(state, hi - lo)
            chosen[kept] = packed[lo + pick] & mask
            kept += 1
            continue
        first = packed[lo] & mask
        x0 = x1 = np.int64(x[first])
        y0 = y1 = np.int64(y[first])
        t0 = t1 = t[first]
        for i in range(lo, hi):
            j = packed[i] & mask
            packed[i] = j
            x0, x1 = min(x0, np.int64(x[j])), max(x1, np.int64(x[j]))
            y0, y1 = min(y0, np.int64(y[j])), max(y1, np.int64(y[j]))
            t0, t1 = min(t0, t[j]), max(t1, t[j])
        side_x, side_y, side_t = (x1 - x0) * wx, (y1 - y0) * wx, np.float64(t1 - t0) * wt
        if side_t >= side_x and side_t >= side_y:
            # times that leave no room for the index lose their lowest bits
            shift = 0
            while (t1 - t0) >> shift >= np.int64(1) << (62 - index_bits):
                shift += 1
            for i in range(lo, hi):
                packed[i] |= ((t[packed[i]] - t0) >> shift) << index_bits
        elif side_x >= side_y:
            for i in range(lo, hi):
                packed[i] |= (np.int64(x[packed[i]]) - x0) << index_bits
        else:
            for i in range(lo, hi):
                packed[i] |= (np.int64(y[packed[i]]) - y0) << index_bits
        middle = (lo + hi) // 2
        _select(packed, lo, hi, middle)
        lows[depth], highs[depth] = middle, hi
        lows[depth + 1], highs[depth + 1] = lo, middle
        depth += 2
    return np.sort(chosen[:kept])


@njit(cache=True, nogil=True)
def _below(state, bound):
    """Next state of a splitmix64 generator and a number in [0, bound)."""
    state += np.uint64(0x9E3779B97F4A7C15)
    z = state
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    z = z ^ (z >> np.uint64(31))
    # the upper 32 bits, scaled: no modulo bias worth the name for boxes below 2^20 events
    return state, np.int64(((z >> np.uint64(32)) * np.uint64(bound)) >> np.uint64(32))


@njit(cache=True, nogil=True)
def _select(values, lo, hi, nth):
    """Quickselect of unique numbers, in place: values[lo:nth] < values[nth:hi]. Expected O(hi - lo)."""
    while hi - lo > 1:
        # median of three guards against sorted input, which is what a camera sends
        middle = (lo + hi) // 2
        a, b, c = values[lo], values[middle], values[hi - 1]
        at = middle if (a < b) == (b < c) else lo if (b < a) == (a < c) else hi - 1
        pivot = values[at]
        values[at] = values[hi - 1]
        # branch-free partition: every value is swapped, only the border moves or does not
        border = lo
        for i in range(lo, hi - 1):
            value = values[i]
            values[i] = values[border]
            values[border] = value
            border += value < pivot
        values[hi - 1] = values[border]
        values[border] = pivot
        if border == nth:
            return
        if nth < border:
            hi = border
        else:
            lo = border + 1
