"""Corner events."""

from __future__ import annotations

import numpy as np

from nvsdata.kernels import _native


def corners(t: np.ndarray, x: np.ndarray, y: np.ndarray, p: np.ndarray, latest: np.ndarray) -> np.ndarray:
    """Return the mask of the events that eFAST finds to be corners. O(N).

    `latest` int64 [2, H, W] has the time of the last event of each pixel, OFF first, or `filters.NEVER` if there is
    none yet. It is updated. Events outside raise an IndexError.
    """
    keep = np.empty(t.size, np.bool_)
    _native.corners(t, x, y, p, latest, keep)
    return keep
