"""Reading windows of stored columns."""

from __future__ import annotations

import numpy as np

from nvsdata.kernels.compiling import njit
from nvsdata.kernels.reading import pread

_U = np.uint64


@njit
def marked_range(marks, base, start, stop):
    """The blocks of a recording that hold events with start <= t < stop; `marks`: the blocks' first times.

    Returns the first block and the one after the last. O(log blocks).
    """
    first = max(_bisect(marks, base, start) - 1, 0)
    return first, max(_bisect(marks, base, stop), first)


@njit
def read_window(
    out_t, out_x, out_y, out_p, base, start, stop, handle, lo, t0, x0, y0, p0, like_t, like_x, like_y, like_p
):
    """`stored_window` of events lo, lo + 1, ... of an open file, as many as fit into the outputs.

    Their columns begin at bytes `t0`, `x0`, `y0` and `p0`, and have the types of `like_t` and so on. Returns
    the number of events, or -1 if the file has fewer bytes than were requested.
    """
    n = out_t.size
    t, x = np.empty(n, like_t.dtype), np.empty(n, like_x.dtype)
    y, p = np.empty(n, like_y.dtype), np.empty(n, like_p.dtype)
    whole = _filled(t, handle, t0, lo) and _filled(x, handle, x0, lo)
    if whole and _filled(y, handle, y0, lo) and _filled(p, handle, p0, lo):
        return stored_window(out_t, out_x, out_y, out_p, base, start, stop, t, x, y, p)
    return -1


@njit
def _filled(column, handle, begin, lo):
    size = column.size * column.itemsize
    return pread(handle, column.ctypes.data, size, begin + lo * column.itemsize) == size


@njit
def stored_window(out_t, out_x, out_y, out_p, base, start, stop, t, x, y, p):
    """Events of stored columns with start <= t + base < stop. O(log N + events found).

    Columns of any integer type are written to `out_t` int64 (with `base` added), `out_x`, `out_y` int16 and `out_p`
    uint8, which must be at least as long. Returns the number of events.
    """
    first = _bisect(t, base, start)
    count = max(_bisect(t, base, stop) - first, 0)
    # one loop per column, so that each is vectorized
    for i in range(_U(count)):
        out_t[i] = np.int64(t[_U(first) + i]) + base
    for i in range(_U(count)):
        out_x[i] = x[_U(first) + i]
    for i in range(_U(count)):
        out_y[i] = y[_U(first) + i]
    for i in range(_U(count)):
        out_p[i] = p[_U(first) + i]
    return count


@njit
def _bisect(t, base, time):
    """First index in `t` whose time is at least `time`."""
    lo, hi = 0, t.size
    while lo < hi:
        middle = (lo + hi) // 2
        if np.int64(t[middle]) + base < time:
            lo = middle + 1
        else:
            hi = middle
    return lo
