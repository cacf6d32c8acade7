"""Windows of stored columns."""

from __future__ import annotations

import numpy as np
from numba import njit

_U = np.uint64


@njit(cache=True, nogil=True)
def marked_range(marks, base, start, stop):
    """Which blocks of a recording hold events with start <= t < stop; `marks` are the blocks' first times.

    Returns the first block and the one after the last. O(log blocks).
    """
    first = max(_bisect(marks, base, start) - 1, 0)
    return first, max(_bisect(marks, base, stop), first)


@njit(cache=True, nogil=True)
def stored_window(t, x, y, p, base, start, stop, out_t, out_x, out_y, out_p):
    """Events of stored columns with start <= t + base < stop. O(log N + events found).

    Columns of any integer type go to t int64 (with `base` added), x, y int16 and p uint8, of the same
    length; returns how many events there are.
    """
    first = _bisect(t, base, start)
    count = max(_bisect(t, base, stop) - first, 0)
    # a loop a column, for the compiler to vectorise
    for i in range(_U(count)):
        out_t[i] = np.int64(t[_U(first) + i]) + base
    for i in range(_U(count)):
        out_x[i] = x[_U(first) + i]
    for i in range(_U(count)):
        out_y[i] = y[_U(first) + i]
    for i in range(_U(count)):
        out_p[i] = p[_U(first) + i]
    return count


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
