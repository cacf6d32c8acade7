"""Events chosen by a mask, or put into order."""

from __future__ import annotations

import numpy as np

from nvsdata.kernels.compiling import njit


@njit
def copy_where(keep, t, x, y, p, to_t, to_x, to_y, to_p):
    """Copy the events at which `keep` is true; the targets need room for one more. O(N), without a branch."""
    n = np.uint64(0)
    for i in range(np.uint64(t.size)):
        to_t[n], to_x[n], to_y[n], to_p[n] = t[i], x[i], y[i], p[i]
        n += np.uint64(keep[i])


@njit
def copy_at(index, t, x, y, p, to_t, to_x, to_y, to_p):
    """Copy the events at indices that are valid. O(N)."""
    for i in range(np.uint64(index.size)):
        j = np.uint64(index[i])
        to_t[i], to_x[i], to_y[i], to_p[i] = t[j], x[j], y[j], p[j]
