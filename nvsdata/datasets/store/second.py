"""Stores of the second layout, HDF5 files that earlier versions packed. `docs/dev/store.md` describes it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from nvsdata.common.errors import FormatError, shown
from nvsdata.common.files import crc32
from nvsdata.common.memory import SharedArray
from nvsdata.data.events import LATEST, MAX_COORDINATE, Columns
from nvsdata.datasets.store.file import LocalFile
from nvsdata.datasets.store.index import unpack_texts
from nvsdata.datasets.store.names import Names
from nvsdata.datasets.store.reader import Store
from nvsdata.datasets.store.record import NAME, NO_BYTES, UNSTATED, Head
from nvsdata.formats.contents import Allowance
from nvsdata.formats.hdf5.chunks import Chunks, values_of
from nvsdata.formats.hdf5.file import (
    check_version,
    dataset_of,
    links_are_followed,
    number_of,
    opened,
    text_of,
)
from nvsdata.formats.hdf5.layouts import STORE
from nvsdata.kernels.decode.order import is_sorted
from nvsdata.kernels.decode.store import marked_range, stored_window

VERSION = 2
COLUMNS = ("t", "x", "y", "p")
INDEX = (
    "offset",
    "base",
    "duration",
    "time",
    "mark",
    "size",
    "bytes",
    "crc",
    "format",
    "name",
    "folder",
    "left_out",
    "reason",
    "file_name",
    "file_offset",
    "file_data",
)
TYPES: dict[str, tuple[str, ...]] = dict.fromkeys(
    ("offset", "base", "duration", "time", "bytes", "file_offset"), ("i8",)
)
TYPES |= {"mark": ("u4", "i8"), "size": ("i4",), "crc": ("u4",)}  # texts and bytes are uint8
TYPES |= {"t": ("u4", "i8"), "x": ("u1", "u2"), "y": ("u1", "u2"), "p": ("u1",)}  # of the events
MARKED = 256  # the index has the time of every 256th event
CHECKED = 1 << 22  # bytes; a window of a recording up to this size is read after all of the recording is verified


class SecondStore(Store):
    """A store of the second layout. The first read of a recording of up to `CHECKED` bytes verifies its checksum.

    Args:
        path: the file.

    Raises:
        FormatError: the file is not a store, is truncated, is of another version, or its index fails its checksum.
    """

    def __init__(self, path: Path) -> None:
        self.root, self.path = path, str(path)
        with opened(path, "not a packed store, or damaged") as file:
            if text_of(file, "format") != STORE:
                raise FormatError(path, f"is neither a folder nor a packed store (format {STORE!r})")
            check_version(path, file, VERSION)
            if number_of(path, file, "version") < VERSION:
                raise FormatError(path, f"a store older than version {VERSION}: pack it again")
            self.dataset, self.split = text_of(file, "dataset"), text_of(file, "split")
            self.fold = number_of(path, file, "fold")
            left = Allowance(path.stat().st_size)
            index = {name: values_of(path, dataset_of(path, file, f"index/{name}", left)) for name in INDEX}
            if checksum(index) != number_of(path, file, "checksum"):
                raise FormatError(path, "its index fails its checksum: pack it again")
            if not _has_types(index):
                raise FormatError(path, "its index has arrays of other types or shapes: pack it again")
            columns = [dataset_of(path, file, f"events/{name}") for name in COLUMNS]
            if not all(column.dtype in TYPES[name] for name, column in zip(COLUMNS, columns, strict=True)):
                raise FormatError(path, "its events are of other types than a store's: pack it again")
            places = [_place(path, column) for column in columns]
            self._event_size = sum(column.dtype.itemsize for column in columns)
            shapes = {column.shape for column in columns}
        first_mark = np.concatenate(([0], np.cumsum(-(-np.diff(index["offset"]) // MARKED))))
        # lists, because reading a number from an array takes as long as the rest of a look-up
        self._offset, self._base, self._duration = (index[name].tolist() for name in ("offset", "base", "duration"))
        self._first_mark = first_mark.tolist()
        self._time = [(None, None) if begin == UNSTATED else (begin, end) for begin, end in index["time"].tolist()]
        self._shapes, self._sizes, self._crc = index["size"], index["bytes"], index["crc"]
        try:
            self.names = Names(index["name"])
            kinds = ("format", "folder", "file_name", "left_out", "reason")
            texts = {name: unpack_texts(index[name].tobytes()) for name in kinds}
            self.left_out = dict(zip(texts["left_out"], texts["reason"], strict=True))
        except ValueError as error:
            raise FormatError(path, f"its index has no valid names: {error}") from None
        self._formats, self._folders = texts["format"], texts["folder"]
        self._files = {name: i for i, name in enumerate(texts["file_name"])}
        self._file_end, self._file_data = index["file_offset"][1:], index["file_data"].tobytes()
        self._marks = index["mark"]
        if not (self._is_sound(index) and shapes == {(self._offset[-1],)} and first_mark[-1] == len(self._marks)):
            raise FormatError(path, "its index contradicts itself: pack it again")
        # compressed columns have no place
        self._places = [place for place in places if place is not None]
        # True for each verified recording; forked workers share it
        self._verified = SharedArray(len(self.names), np.bool_)
        self._file = LocalFile(path)

    def _is_sound(self, index: dict[str, np.ndarray]) -> bool:
        """Return whether the arrays of the index agree on the number of recordings, and have possible values."""
        counts = {len(index[name]) for name in ("base", "duration", "time", "size", "bytes", "crc")}
        counts |= {len(self.names), len(self._formats), len(self._offset) - 1}
        sizes, base, files = index["size"], index["base"], index["file_offset"]
        in_line = self._offset[:1] == [0] and not (np.diff(index["offset"]) < 0).any()
        # texts end with a zero each
        if not (len(counts) == 1 and in_line and len(files) == np.count_nonzero(index["file_name"] == 0) + 1):
            return False
        if files[0] != 0 or files[-1] != len(index["file_data"]) or (np.diff(files) < 0).any():
            return False
        times = (base > -LATEST) & (base < LATEST) & (index["duration"] >= 0) & (index["duration"] < LATEST - base)
        begin, end = index["time"].T
        stated = (begin > -LATEST) & (begin <= base) & (end < LATEST) & (end >= base + index["duration"])
        times &= stated | ((begin == UNSTATED) & (end == UNSTATED))
        return bool(times.all() and ((sizes > 0) & (sizes <= MAX_COORDINATE + 1)).all())

    def stamp(self, name: str) -> tuple[int, ...]:
        """Return (checksum of the events, time of the first event in µs, width, height)."""
        number = self.names.number(name)
        head, _ = self.head(number)
        return int(self._crc[number]), head.span[0], *head.size

    def head(self, number: int) -> tuple[Head, np.ndarray]:
        """Return what the index states of a recording, and no bytes."""
        base: int = self._base[number]
        width, height = self._shapes[number].tolist()
        start = np.frombuffer(self._formats[number].encode().ljust(NAME, b"\0"), np.uint8)
        span = base, base + self._duration[number]
        return Head(span, self._time[number], (width, height), start, NO_BYTES, (4, 1), False), NO_BYTES

    def read(self, number: int, head: Head, raw: np.ndarray, start: int, stop: int) -> Columns:
        """Return a recording's events with start <= t < stop (µs); a window of a large one isn't verified."""
        lo, hi, base = self._offset[number], self._offset[number + 1], head.span[0]
        verified = self._verified.values[number]
        if verified or not (stored := self._verify(number, head, start, stop)):
            marks = self._marks[self._first_mark[number] : self._first_mark[number + 1]]
            first, last = marked_range(marks, base, start, stop)
            stored = self._raw(lo + first * MARKED, max(lo + first * MARKED, min(lo + last * MARKED, hi)))
        columns = Columns.empty(stored[0].size)
        columns = columns.first(stored_window(*columns, base, start, stop, *stored))
        if not verified:
            self._check_inside(number, columns, head.size)
        if not is_sorted(columns.t):
            raise FormatError(self.path, f"events of {shown(self.names[number])} are out of order: pack it again")
        return columns

    def _verify(self, number: int, head: Head, start: int, stop: int) -> list[np.ndarray] | None:
        """Return all events of a recording as stored, verified; None if that takes much longer than the window."""
        lo, hi = self._offset[number], self._offset[number + 1]
        first, last = head.span
        if (hi - lo) * self._event_size > CHECKED and (start > first or stop <= last):
            return None
        raw = self._raw(lo, hi)
        if crc_of(raw) != int(self._crc[number]):
            reason = "its events fail their checksum: the store is damaged, pack the recording again"
            _, size, begin = self._places[0] if self._places else (None, 0, 0)
            raise FormatError(f"{self.path}:{self.names[number]}", reason, offset=begin + lo * size if size else None)
        self._check(number, raw, head)
        return raw

    def _check(self, number: int, raw: list[np.ndarray], head: Head) -> None:
        """Mark a recording whose checksum is right as verified; FormatError if the index contradicts its events."""
        marks = self._marks[self._first_mark[number] : self._first_mark[number + 1]]
        ends = (raw[0][0], raw[0][-1]) if raw[0].size else (0, self._duration[number])
        if ends != (0, self._duration[number]) or not np.array_equal(raw[0][::MARKED], marks):
            raise FormatError(self.path, f"its index has other times than {shown(self.names[number])}: pack it again")
        self._check_inside(number, raw, head.size)
        self._verified.values[number] = True

    def _check_inside(self, number: int, columns: Sequence[np.ndarray], size: tuple[int, int]) -> None:
        """Raise FormatError unless the events of a recording are on a sensor of this size, with polarities 0 and 1."""
        # as uint16, negative numbers are larger than all others
        x, y = (column.view(np.uint16) if column.dtype == np.int16 else column for column in columns[1:3])
        if x.size and (x.max() >= size[0] or y.max() >= size[1] or columns[3].max() > 1):
            reason = f"coordinates outside the sensor of {size[0]}x{size[1]}, or polarities other than 0 and 1"
            raise FormatError(f"{self.path}:{self.names[number]}", reason)

    def _raw(self, lo: int, hi: int) -> list[np.ndarray]:
        """Return events lo to hi - 1 as they are stored.

        They are read and not memory-mapped, because mapping a page takes longer than reading it, and a mapped page
        stays in memory.
        """
        if len(self._places) == len(COLUMNS):
            return [self._column(lo, hi, *place) for place in self._places]
        with opened(self.root, f"can't read events {lo} to {hi}") as file:
            columns = [
                Chunks(self.root, dataset_of(self.root, file, f"events/{name}")).read(lo, hi) for name in COLUMNS
            ]
        if any(column.shape != (hi - lo,) for column in columns):
            raise FormatError(self.path, "was changed while it was read: open it again")
        return columns

    def _column(self, lo: int, hi: int, kind: np.dtype[Any], size: int, begin: int) -> np.ndarray:
        """Return items lo to hi - 1 of a column whose items have `size` bytes and begin at the byte `begin`."""
        items = np.empty(hi - lo, kind)
        self._file.fill(begin + lo * size, items)
        return items

    def blocks(self, names: Sequence[str], size: int) -> None:
        """Return None, because the columns of a recording lie apart."""

    def fault(self, name: str) -> str:
        """Return why the events of a recording can't be read or were changed; empty if they are intact."""
        number = self.names.number(name)
        try:
            raw = self._raw(self._offset[number], self._offset[number + 1])
            if crc_of(raw) != int(self._crc[number]):
                return "its events fail their checksum"
            self._check(number, raw, self.head(number)[0])
        except FormatError as error:
            return error.reason
        return ""


def checksum(index: dict[str, np.ndarray]) -> int:
    """Return the CRC-32 of the arrays of the index, in the order of `INDEX`."""
    return crc_of([index[name] for name in INDEX])


def crc_of(arrays: list[np.ndarray]) -> int:
    """Return the CRC-32 of the bytes of all arrays in sequence."""
    value = 0
    for array in arrays:
        value = crc32(np.ascontiguousarray(array).data.cast("B") if array.size else b"", value)
    return value


def _place(path: Path, dataset: Any) -> tuple[np.dtype[Any], int, int] | None:
    """Return type, item size and first byte of a column that is contiguous in the file; None for a compressed one."""
    offset = dataset.id.get_offset()
    # a column in chunks has no offset
    if dataset.size and (links_are_followed() or offset is None):
        return None
    if offset is not None and offset + dataset.nbytes > path.stat().st_size:
        raise FormatError(path, f"cut short within {dataset.name}", offset=offset)
    return dataset.dtype, dataset.dtype.itemsize, offset or 0


def _has_types(index: dict[str, np.ndarray]) -> bool:
    """Return whether the arrays of an index have the types and the number of axes that `docs/dev/store.md` states."""
    shapes = {"time": (-1, 2), "size": (-1, 2)}
    fits = all(array.shape[1:] == shapes.get(name, (-1,))[1:] and array.ndim >= 1 for name, array in index.items())
    return fits and all(array.dtype in TYPES.get(name, ("u1",)) for name, array in index.items())
