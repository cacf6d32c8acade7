"""Whether events lie on their sensor, so that other kernels may take their coordinates as indices unchecked."""

from __future__ import annotations

import numpy as np

from nvsdata.kernels.compiling import njit


@njit
def inside(t, x, y, p, width, height):
    """Whether columns are equally long, pixels lie on a sensor of `width` x `height`, polarities are 0 or 1. O(N)."""
    if x.size != t.size or y.size != t.size or p.size != t.size:
        return False
    if t.size == 0:
        return True
    # the least and the largest, without branches
    left, right, top, bottom, least, most = x[0], x[0], y[0], y[0], p[0], p[0]
    for i in range(np.uint64(t.size)):
        left, right, top, bottom = min(left, x[i]), max(right, x[i]), min(top, y[i]), max(bottom, y[i])
        least, most = min(least, p[i]), max(most, p[i])
    return left >= 0 and right < width and top >= 0 and bottom < height and least >= 0 and most < 2
