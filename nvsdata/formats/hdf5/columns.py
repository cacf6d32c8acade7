"""Columns of HDF5 files: uncompressed values are read directly, others by the HDF5 library."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from contextlib import AbstractContextManager
from functools import cache
from types import TracebackType
from typing import Any

import h5py
import numpy as np

from nvsdata.common.errors import FormatError
from nvsdata.formats.contents import Allowance
from nvsdata.formats.hdf5.chunks import Chunks
from nvsdata.formats.hdf5.file import check_stored, dataset_of, opened, places_of
from nvsdata.formats.ondisk import OnDisk, OpenFile
from nvsdata.kernels.decode.order import is_sorted

BLOCK = 1 << 20  # bytes that are converted at a time; they fit the processor's cache
SCANNED = 1 << 20  # values that are checked at a time
BISECTED = 512  # bisection ends at this number of values


class ColumnFile(OpenFile):
    """A file that is open while a block reads its columns; the HDF5 library opens it only to decode compressed ones."""

    __slots__ = ("_chunks", "_library")

    def __enter__(self) -> ColumnFile:
        super().__enter__()
        self._library: AbstractContextManager[Any] | None = None
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, tb: TracebackType | None) -> None:
        super().__exit__(kind, error, tb)
        if self._library is not None:
            self._library.__exit__(kind, error, tb)

    def chunks(self, name: str) -> Chunks:
        """Return the `Chunks` of the dataset `name`, which must be decoded."""
        if self._library is None:
            self._library = opened(self.file.path, "can't read the events")
            file = self._library.__enter__()
            # one object per dataset, because it caches a decompressed chunk
            self._chunks = cache(lambda name: Chunks(self.file.path, dataset_of(self.file.path, file, name)))
        return self._chunks(name)


class Column(ABC):
    """A column of `size` integers in an HDF5 file."""

    def __init__(self, name: str, size: int) -> None:
        self.name, self.size = name, size
        self._seen: dict[int, int] = {}  # values that bisections have read; all bisections begin with the same ones

    def value(self, source: ColumnFile, i: int) -> int:
        """Return the value at index i."""
        if i not in self._seen:
            self._seen[i] = int(self.read(source, i, i + 1)[0])
        return self._seen[i]

    @abstractmethod
    def read(self, source: ColumnFile, lo: int, hi: int, kind: Any = None) -> np.ndarray:
        """Return values lo to hi (excluded) in new memory.

        They have type `kind` if it can hold every value of the stored type, otherwise the stored type.
        """


class Plain(Column):
    """An uncompressed column: `length` values are stored at each of the offsets `places`."""

    def __init__(self, file: OnDisk, name: str, kind: Any, size: int, places: Sequence[int], length: int) -> None:
        super().__init__(name, size)
        self.kind, self._places, self._length = kind, places, length
        for i, place in enumerate(places):
            if place + min(length, size - i * length) * kind.itemsize > file.size:
                raise FormatError(file.path, f"truncated within /{name}", offset=place)

    def read(self, source: ColumnFile, lo: int, hi: int, kind: Any = None) -> np.ndarray:
        widened = kind is not None and np.can_cast(self.kind, kind)
        values = np.empty(max(hi - lo, 0), kind if widened else self.kind)
        buffer = np.empty(min(values.size, BLOCK // self.kind.itemsize), self.kind) if widened else values
        done = 0
        while done < values.size:
            part, first = divmod(lo + done, self._length)
            count = min(values.size - done, self._length - first, max(buffer.size, 1))
            target = values[done : done + count]
            raw = target if buffer is values else buffer[:count]
            source.fill(self._places[part] + first * self.kind.itemsize, raw)
            if raw is not target:
                target[:] = raw
            done += count
        return values


class Stored(Column):
    """A column, or a field of a table, that must be decoded: it is compressed, or its values aren't adjacent."""

    def __init__(self, name: str, size: int, field: str | None = None, chunk: int = 0) -> None:
        super().__init__(name, size)
        self._field = field
        self.chunk = chunk  # values per chunk, 0 if unknown

    def read(self, source: ColumnFile, lo: int, hi: int, kind: Any = None) -> np.ndarray:
        rows = source.chunks(self.name).read(lo, max(lo, hi))
        # a copy, because kernels need contiguous arrays, and the rows are kept for the other fields
        values = rows if self._field is None else rows[self._field].copy()
        if values.shape != (max(hi - lo, 0),) or values.dtype.kind not in "iub":
            raise FormatError(source.file.path, f"/{self.name} was changed while it was read: open the file again")
        values = values.astype(np.uint8) if values.dtype.kind == "b" else values
        return values.astype(kind, copy=False) if kind is not None and np.can_cast(values.dtype, kind) else values


def column_of(file: OnDisk, name: str, dataset: Any, left: Allowance) -> Column:
    """Return the column in `dataset`, an object of h5py's low-level API. FormatError unless its values are integers.

    `left` is the limit on the bytes to which this column and others may expand together.
    """
    if not isinstance(dataset, h5py.h5d.DatasetID):
        raise FormatError(file.path, f"/{name} is not a dataset")
    layout, shape = check_stored(file.path, dataset, left)
    kind = dataset.dtype
    if len(shape) != 1 or kind.kind not in "iub":
        raise FormatError(file.path, f"/{name} is not a column of integers")
    places, length = places_of(dataset, layout, shape[0])
    if not places:
        chunked = layout.get_layout() == h5py.h5d.CHUNKED
        return Stored(name, shape[0], chunk=layout.get_chunk()[0] if chunked else 0)
    return Plain(file, name, np.dtype(np.uint8) if kind.kind == "b" else kind, shape[0], places, length)


def bisected(column: Column, source: ColumnFile, value: int) -> tuple[int, int]:
    """Return two indices, at most `BISECTED` apart, between which a sorted column first reaches `value`."""
    lo, hi = 0, column.size
    while hi - lo > BISECTED:
        middle = (lo + hi) // 2
        if column.value(source, middle) < value:
            lo = middle + 1
        else:
            hi = middle
    return lo, hi


def rises(column: Column, source: ColumnFile) -> bool:
    """Return whether a column never decreases."""
    for lo in range(0, column.size, SCANNED):
        values = column.read(source, max(lo - 1, 0), min(lo + SCANNED, column.size))
        # unsigned values beyond int64 become negative, so that the column isn't sorted
        if not is_sorted(values.astype(np.int64, copy=False)):
            return False
    return True
