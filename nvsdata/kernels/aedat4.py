"""Events of AEDAT 4 to columns."""

from __future__ import annotations

import numpy as np

from nvsdata.kernels.compiling import njit

_U = np.uint64


@njit
def aedat4_decode(words, latest, width, height, t, x, y, p):
    """Write the columns of events of two int64 words each; returns whether all are valid. O(N).

    A word of time, then x, y and polarity in 16 bits each, of which polarity has only 8. Valid are times between
    -`latest` and `latest`, both excluded, places inside the sensor, and polarities 0 and 1.
    """
    odd = False
    for i in range(_U(t.size)):
        time, rest = words[_U(2) * i], words[_U(2) * i + _U(1)]
        column, row, on = rest & 0xFFFF, (rest >> 16) & 0xFFFF, (rest >> 32) & 0xFF
        odd |= (time <= -latest) | (time >= latest) | (column >= width) | (row >= height) | (on > 1)
        t[i], x[i], y[i], p[i] = time, column, row, on
    return not odd
