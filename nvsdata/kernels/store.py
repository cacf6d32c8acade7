"""Windows of stored columns."""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True, nogil=True)
def marked_range(marks, base, start, stop):
    """Which blocks of a recording hold events with start <= t < stop; `marks` are the blocks' first times.

    Returns the first block and the one after the last. O(log blocks).
    """
    first = max(_bisect(marks, base, start) - 1, 0)
    return first, max(_bisect(marks, base, stop), first)


@njit(cache=True, nogil=True)
def stored_window(t, x, y, p, base, start, stop):
    """Events of stored columns with start <= t + base < stop. O(log N + events found).

    Columns of any integer type; returns t int64 (with `base` added), x, y int16 and p uint8.
    """
    first = _bisect(t, base, start)
    last = max(_bisect(t, base, stop), first)
    # a loop a column, for the compiler to vectorise
    out_t = t[first:last].astype(np.int64)
    out_t += base
    return out_t, x[first:last].astype(np.int16), y[first:last].astype(np.int16), p[first:last].astype(np.uint8)


@njit(cache=True, nogil=True)
def _bisect(t, base, time):
    """First place in `t` whose time is at least `time`."""
    lo, hi = 0, t.size
    while lo < hi:
        middle = (lo + hi) // 2
        if np.int64(t[middle]) + base < time:
            lo = middle + 1
        else:
            hi = middle
    return lo
