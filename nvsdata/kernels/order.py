"""Order in time."""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True, nogil=True)
def is_sorted(t):
    """Whether no value is smaller than the one before it. O(N), no memory."""
    block = 4096
    for start in range(1, t.size, block):
        falls = 0
        # no exit within a block, so that it is vectorized
        for i in range(np.uint64(start), np.uint64(min(start + block, t.size))):
            falls += t[i] < t[i - np.uint64(1)]
        if falls:
            return False
    return True
