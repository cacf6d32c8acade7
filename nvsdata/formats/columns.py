"""Columns as other programs write them, converted to integers: what `.mat`, `.npy` and HDF5 files share."""

from __future__ import annotations

import numpy as np

from nvsdata.common.errors import FormatError
from nvsdata.data.events import LATEST


def integers(path: str, name: str, column: np.ndarray) -> np.ndarray:
    """A column of any numeric type as integers; integers keep their type.

    FormatError, which names the column as `name`, for fractions, NaN, and numbers at or beyond 2^62.
    """
    if column.dtype.kind == "b":
        return column.astype(np.uint8)
    if column.dtype.kind == "f":
        # NaN fails the comparison, too
        if not ((np.abs(column) < LATEST) & (column == np.rint(column))).all():
            raise FormatError(path, f"{name} holds numbers that aren't whole, or beyond 2^62")
        return column.astype(np.int64)
    if column.dtype.itemsize == 8 and column.size and not -LATEST < column.min() <= column.max() < LATEST:
        raise FormatError(path, f"{name} holds numbers beyond 2^62")
    return column


def polarity(column: np.ndarray) -> np.ndarray:
    """Polarity as 0 and 1, where OFF may be -1."""
    return np.where(column == -1, 0, column) if column.dtype.kind == "i" else column
