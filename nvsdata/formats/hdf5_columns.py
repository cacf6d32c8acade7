"""Columns of HDF5 files: read in place where they lie in the file as they are, else by the library."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import AbstractContextManager
from functools import cache, partial
from types import TracebackType
from typing import Any, Protocol

import h5py
import numpy as np

from nvsdata.common.errors import FormatError
from nvsdata.formats.hdf5_file import check_stored, dataset_of, opened, places_of
from nvsdata.formats.ondisk import OnDisk, OpenFile
from nvsdata.kernels.order import is_sorted

BLOCK = 1 << 20  # bytes that are converted at a time: they stay in the cache
SCANNED = 1 << 20  # values that are looked at together
BISECTED = 512  # values that are read rather than bisected further


class Source(OpenFile):
    """A file while a block reads its columns; the library opens it for those alone that it must decode."""

    __slots__ = ("_dataset", "_library")

    def __enter__(self) -> Source:
        super().__enter__()
        self._library: AbstractContextManager[Any] | None = None
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, tb: TracebackType | None) -> None:
        super().__exit__(kind, error, tb)
        if self._library is not None:
            self._library.__exit__(kind, error, tb)

    def dataset(self, name: str) -> Any:
        """A dataset as the library reads it."""
        if self._library is None:
            self._library = opened(self.file.path, "can't read the events")
            # what is open keeps what it has decompressed
            self._dataset = cache(partial(dataset_of, self.file.path, self._library.__enter__()))
        return self._dataset(name)


class Column(Protocol):
    """A column of `size` integers."""

    name: str
    size: int

    def value(self, source: Source, i: int) -> int:
        """A single value."""

    def read(self, source: Source, lo: int, hi: int, kind: Any = None) -> np.ndarray:
        """Values lo..hi in memory of their own: in `kind` if that holds all values of their type, else in their own."""


class Plain:
    """A column that lies in the file as it is: at `places`, `length` values each."""

    def __init__(self, file: OnDisk, name: str, kind: Any, size: int, places: Sequence[int], length: int) -> None:
        self.name, self.kind, self.size = name, kind, size
        self._places, self._length = places, length
        self._seen: dict[int, int] = {}  # a bisection begins where the last one did
        for i, place in enumerate(places):
            if place + min(length, size - i * length) * kind.itemsize > file.size:
                raise FormatError(file.path, place, f"truncated within /{name}")

    def value(self, source: Source, i: int) -> int:
        if i not in self._seen:
            part, first = divmod(i, self._length)
            one = np.empty(1, self.kind)
            source.fill(self._places[part] + first * self.kind.itemsize, one)
            self._seen[i] = int(one[0])
        return self._seen[i]

    def read(self, source: Source, lo: int, hi: int, kind: Any = None) -> np.ndarray:
        widened = kind is not None and np.can_cast(self.kind, kind)
        values = np.empty(max(hi - lo, 0), kind if widened else self.kind)
        room = np.empty(min(values.size, BLOCK // self.kind.itemsize), self.kind) if widened else values
        done = 0
        while done < values.size:
            part, first = divmod(lo + done, self._length)
            count = min(values.size - done, self._length - first, max(room.size, 1))
            target = values[done : done + count]
            raw = target if room is values else room[:count]
            source.fill(self._places[part] + first * self.kind.itemsize, raw)
            if raw is not target:
                target[:] = raw
            done += count
        return values


class Stored:
    """A column, or a field of a table, that the library reads: it is compressed, or spread over rows."""

    def __init__(self, name: str, size: int, field: str | None = None) -> None:
        self.name, self.size, self._field = name, size, field

    def value(self, source: Source, i: int) -> int:
        return int(self.read(source, i, i + 1)[0])

    def read(self, source: Source, lo: int, hi: int, kind: Any = None) -> np.ndarray:
        rows = source.dataset(self.name)[lo : max(lo, hi)]
        values = np.asarray(rows if self._field is None else rows[self._field])
        values = values.astype(np.uint8) if values.dtype.kind == "b" else values
        return values.astype(kind, copy=False) if kind is not None and np.can_cast(values.dtype, kind) else values


def column_of(file: OnDisk, name: str, dataset: Any) -> Column:
    """The column that an object of h5py's lower level is; FormatError if it is none of integers."""
    if not isinstance(dataset, h5py.h5d.DatasetID):
        raise FormatError(file.path, None, f"/{name} is no dataset")
    layout, shape = check_stored(file.path, dataset)
    kind = dataset.dtype
    if len(shape) != 1 or kind.kind not in "iub":
        raise FormatError(file.path, None, f"/{name} is no column of integers")
    places, length = places_of(dataset, layout, shape[0])
    if not places:
        return Stored(name, shape[0])
    return Plain(file, name, np.dtype(np.uint8) if kind.kind == "b" else kind, shape[0], places, length)


def narrowed(column: Column, source: Source, value: int) -> tuple[int, int]:
    """Two indices at most `BISECTED` apart, between which a column that never falls comes to `value` or more."""
    lo, hi = 0, column.size
    while hi - lo > BISECTED:
        middle = (lo + hi) // 2
        if column.value(source, middle) < value:
            lo = middle + 1
        else:
            hi = middle
    return lo, hi


def rises(column: Column, source: Source) -> bool:
    """Whether no value of a column is smaller than the one before it."""
    for lo in range(0, column.size, SCANNED):
        values = column.read(source, max(lo - 1, 0), min(lo + SCANNED, column.size))
        # of one type, or the kernel is compiled for each; what is beyond it wraps, and falls
        if not is_sorted(values.astype(np.int64, copy=False)):
            return False
    return True
