"""Events chosen by a mask or by indices."""

from __future__ import annotations

import numpy as np

from nvsdata.kernels import _native


def copy_where(keep: np.ndarray, *columns: np.ndarray) -> None:
    """Copy the events, columns t, x, y, p, at which `keep` is true to others, which need room for one more. O(N)."""
    _native.copy_where(keep, *columns)


def copy_at(index: np.ndarray, *columns: np.ndarray) -> None:
    """Copy the events, columns t, x, y, p, at indices, int32 or int64, to others. O(N).

    IndexError for an index of no event.
    """
    _native.copy_at(index, *columns)
