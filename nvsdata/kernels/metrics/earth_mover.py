"""Moving mass between points at least cost: the transportation problem, by the network simplex method."""

from __future__ import annotations

import numpy as np

from nvsdata.kernels import _native


def least_work(ax: np.ndarray, ay: np.ndarray, am: np.ndarray, bx: np.ndarray, by: np.ndarray, bm: np.ndarray) -> float:
    """Return the least sum of mass times Euclidean distance that moves min(sum am, sum bm) from a to b, (3.15).

    `ax`, `ay`, `bx`, `by` are float64, `am`, `bm` int64. O(N + M) memory; costs are computed again at each use, which
    is no slower than reading a matrix. ValueError for no points, and for masses below 1 or with a sum of 2^62 or more.
    """
    work: float = _native.least_work(ax, ay, am, bx, by, bm)
    return work
