"""The packed store: all recordings of a dataset in one HDF5 file. `docs/store.md` describes its layout."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

from nvsdata.common.errors import FormatError, shown
from nvsdata.common.files import crc32
from nvsdata.common.memory import SharedArray
from nvsdata.data.events import EVER, LATEST, MAX_COORDINATE, Columns, Events, bounds_of, check_window
from nvsdata.data.recording import Recording
from nvsdata.datasets.source import Listing
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
from nvsdata.formats.ondisk import read_into
from nvsdata.kernels.decode.order import is_sorted
from nvsdata.kernels.decode.store import marked_range, read_window, stored_window

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
UNSTATED = np.iinfo(np.int64).min  # in place of beginning and end of a recording whose file doesn't state them
MARKED = 256  # the index has the time of every 256th event
CHECKED = 1 << 22  # bytes; a window of a recording up to this size is read after all of the recording is verified


class Store:
    """A packed store, opened for reading: a `Source` of recordings and side files.

    Pickling is cheap: only the path is sent to workers, and each process opens the file itself. The first read of a
    recording verifies its checksum (FormatError if it fails), unless the environment variable `NVSDATA_STORE_CHECK` is
    0 or only a window of a recording with more than 4 MiB of events is read.

    Args:
        path: the file.

    Attributes:
        dataset: `info.name` of the dataset.
        split: the split that was packed.
        fold: the fold that was packed.
        names: names of the recordings, by number.
        left_out: recordings that couldn't be packed, name to reason.

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
        self._time = [None if begin == UNSTATED else (begin, end) for begin, end in index["time"].tolist()]
        self._sizes, self._sources, self._crc = index["size"], index["bytes"], index["crc"]
        try:
            texts = {name: unpack_texts(index[name]) for name in ("name", "format", "folder", "file_name")}
            self.left_out = dict(zip(unpack_texts(index["left_out"]), unpack_texts(index["reason"]), strict=True))
        except ValueError as error:
            raise FormatError(path, f"its index has no valid names: {error}") from None
        self.names, self.formats, self._folders = texts["name"], texts["format"], texts["folder"]
        self._number = {name: i for i, name in enumerate(self.names)}
        self._files = {name: i for i, name in enumerate(texts["file_name"])}
        self._file_offset, self._file_data = index["file_offset"], index["file_data"]
        self._marks = index["mark"]
        if not (self._is_sound(index) and shapes == {(self._offset[-1],)} and first_mark[-1] == len(self._marks)):
            raise FormatError(path, "its index contradicts itself: pack it again")
        # compressed columns have no place
        self._places = [place for place in places if place is not None]
        # arguments for `read_window`, if it can read the columns
        begins, widths = [begin for *_, begin in self._places], [width for _, width, _ in self._places]
        self._direct = (*begins, *widths[:3]) if len(widths) == len(COLUMNS) and hasattr(os, "pread") else ()
        # True for each verified recording; forked workers share it
        self._verified = SharedArray(len(self.names), np.bool_)
        self._verified.values[:] = os.environ.get("NVSDATA_STORE_CHECK") == "0"
        self._file = path.open("rb", buffering=0)
        self._handle = self._file.fileno()

    def __reduce__(self) -> tuple[type, tuple[Path]]:
        return Store, (self.root,)

    def _is_sound(self, index: dict[str, np.ndarray]) -> bool:
        """Return whether the arrays of the index agree on the number of recordings, and have possible values."""
        counts = {len(index[name]) for name in ("base", "duration", "time", "size", "bytes", "crc")}
        counts |= {len(self.names), len(self.formats), len(self._offset) - 1}
        sizes, base, files = index["size"], index["base"], index["file_offset"]
        in_line = self._offset[:1] == [0] and not (np.diff(index["offset"]) < 0).any()
        # texts end with a zero each
        if not (len(counts) == 1 and in_line and len(files) == np.count_nonzero(index["file_name"] == 0) + 1):
            return False
        if files[0] != 0 or files[-1] != len(index["file_data"]) or (np.diff(files) < 0).any():
            return False
        times = (base > -LATEST) & (base < LATEST) & (index["duration"] >= 0) & (index["duration"] < LATEST - base)
        return bool(times.all() and ((sizes > 0) & (sizes <= MAX_COORDINATE + 1)).all())

    def listing(self) -> Listing:
        """Return the packed folders and recordings, including those left out, and the side files."""
        found: Listing = {folder: [] for folder in self._folders}
        for name in (*self.names, *self.left_out, *self._files):
            folder, _, file = name.rpartition("/")
            found.setdefault(folder or ".", []).append(file)
        return {folder: sorted(found[folder]) for folder in sorted(found)}

    def open(self, name: str, sensor_size: tuple[int, int] | None, *, strict: bool = True) -> StoredRecording:
        """Return a recording; FormatError if it was left out. `strict` has no effect: only intact files are packed."""
        if name in self.left_out:
            raise FormatError(self.root, f"{shown(name)} was left out when it was packed: {self.left_out[name]}")
        return StoredRecording(self, self._number[name], sensor_size)

    def data(self, name: str) -> bytes:
        """Return the bytes of a side file."""
        i = self._files[name]
        return self._file_data[self._file_offset[i] : self._file_offset[i + 1]].tobytes()

    def size(self, name: str) -> int:
        """Return the size in bytes of the file that was packed."""
        if name in self._files:
            return len(self.data(name))
        return int(self._sources[self._number[name]])

    def content(self, name: str) -> tuple[int, ...]:
        """Return the stamp, which doesn't depend on the name."""
        return self.stamp(name)

    def stamp(self, name: str) -> tuple[int, ...]:
        """Return (checksum of the events, time of the first event in µs, width, height).

        The checksum doesn't cover the last three.
        """
        number = self._number[name]
        return int(self._crc[number]), self._base[number], *self.sensor_size(number)

    def settled(self, name: str, at: int) -> bool:
        """Return True, because a store doesn't change."""
        return True

    def read(self, number: int, start: int, stop: int) -> Columns:
        """Return a recording's events with start <= t < stop (µs).

        A recording of up to `CHECKED` bytes is verified first. Of a verified or a larger one, only the window is read.
        """
        lo, hi, base = self._offset[number], self._offset[number + 1], self._base[number]
        verified = self._verified.values[number]
        if not verified and (raw := self._verify(number, start, stop)):
            columns = Columns.empty(hi - lo)
            return columns.first(stored_window(*columns, base, start, stop, *raw))
        marks = self._marks[self._first_mark[number] : self._first_mark[number + 1]]
        first, last = marked_range(marks, base, start, stop)
        lo, hi = lo + first * MARKED, min(lo + last * MARKED, hi)
        columns = Columns.empty(max(hi - lo, 0))
        count = -1
        if self._direct:
            count = read_window(*columns, base, start, stop, self._handle, lo, *self._direct)
        if count < 0:
            # reads compressed columns, or raises the error for columns that are too short
            count = stored_window(*columns, base, start, stop, *self._raw(lo, max(lo, hi)))
        columns = columns.first(count)
        if not verified:
            self.check_inside(number, columns.x, columns.y, columns.p, self.sensor_size(number))
        if not is_sorted(columns.t):
            raise FormatError(self.root, f"events of {shown(self.names[number])} are out of order: pack it again")
        return columns

    def _verify(self, number: int, start: int, stop: int) -> list[np.ndarray] | None:
        """Return all events of a recording as stored, verified; None if that takes much longer than the window."""
        lo, hi = self._offset[number], self._offset[number + 1]
        first, last = self.span(number)
        if (hi - lo) * self._event_size > CHECKED and (start > first or stop <= last):
            return None
        raw = self._raw(lo, hi)
        if crc_of(raw) != int(self._crc[number]):
            reason = "its events fail their checksum: the store is damaged, pack the recording again"
            _, size, begin = self._places[0] if self._places else (None, 0, 0)
            raise FormatError(f"{self.path}:{self.names[number]}", reason, offset=begin + lo * size if size else None)
        self._check(number, raw)
        return raw

    def _check(self, number: int, raw: list[np.ndarray]) -> None:
        """Mark a recording whose checksum is right as verified; FormatError if the index contradicts its events."""
        marks = self._marks[self._first_mark[number] : self._first_mark[number + 1]]
        ends = (raw[0][0], raw[0][-1]) if raw[0].size else (0, self._duration[number])
        if ends != (0, self._duration[number]) or not np.array_equal(raw[0][::MARKED], marks):
            raise FormatError(self.root, f"its index has other times than {shown(self.names[number])}: pack it again")
        self.check_inside(number, raw[1], raw[2], raw[3], self.sensor_size(number))
        self._verified.values[number] = True

    def check_inside(self, number: int, x: np.ndarray, y: np.ndarray, p: np.ndarray, size: tuple[int, int]) -> None:
        """Raise FormatError unless the events of a recording are on a sensor of this size, with polarities 0 and 1."""
        # as uint16, negative numbers are larger than all others
        x, y = (column.view(np.uint16) if column.dtype == np.int16 else column for column in (x, y))
        if x.size and (x.max() >= size[0] or y.max() >= size[1] or p.max() > 1):
            reason = f"coordinates outside the sensor of {size[0]}x{size[1]}, or polarities other than 0 and 1"
            raise FormatError(f"{self.path}:{self.names[number]}", reason)

    def span(self, number: int) -> tuple[int, int]:
        """Return the times in µs of the first and the last event of a recording."""
        base: int = self._base[number]
        return base, base + self._duration[number]

    def time(self, number: int) -> tuple[int | None, int | None]:
        """Return start and end of a recording in µs as its file states them; None if it doesn't."""
        return self._time[number] or (None, None)

    def sensor_size(self, number: int) -> tuple[int, int]:
        """Return the sensor size (width, height) in pixels that a recording had when it was packed."""
        width, height = self._sizes[number].tolist()
        return width, height

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
            raise FormatError(self.root, "was changed while it was read: open it again")
        return columns

    def _column(self, lo: int, hi: int, kind: np.dtype[Any], size: int, begin: int) -> np.ndarray:
        """Return items lo to hi - 1 of a column whose items have `size` bytes and begin at the byte `begin`."""
        items = np.empty(hi - lo, kind)
        read_into(self._handle, self.path, begin + lo * size, items)
        return items

    def fault(self, name: str) -> str:
        """Return why the events of a recording can't be read or were changed; empty if they are intact."""
        number = self._number[name]
        try:
            raw = self._raw(self._offset[number], self._offset[number + 1])
            if crc_of(raw) != int(self._crc[number]):
                return "its events fail their checksum"
            self._check(number, raw)
        except FormatError as error:
            return error.reason
        return ""


class StoredRecording(Recording):
    """A recording in a store; if `sensor_size` is None, it has the size with which it was packed."""

    def __init__(self, store: Store, number: int, sensor_size: tuple[int, int] | None) -> None:
        self._store, self._number = store, number
        packed_size = store.sensor_size(number)
        self._size = packed_size if sensor_size is None else sensor_size
        self._fits = self._size[0] >= packed_size[0] and self._size[1] >= packed_size[1]
        self._time = store.time(number)
        self.repairs = {}

    @property
    def path(self) -> str:  # type: ignore[override]
        """Path of the recording: the path of the store, a colon, and the recording's name."""
        return f"{self._store.path}:{self._store.names[self._number]}"

    @property
    def format(self) -> str:  # type: ignore[override]
        """Format of the file from which the recording was packed."""
        return self._store.formats[self._number]

    @property
    def sensor_size(self) -> tuple[int, int]:
        return self._size

    @property
    def span(self) -> tuple[int, int]:
        return self._store.span(self._number)

    @property
    def start(self) -> int:
        return self.span[0] if self._time[0] is None else self._time[0]

    @property
    def end(self) -> int:
        return self.span[1] if self._time[1] is None else self._time[1]

    def read(self, start: int | None = None, stop: int | None = None) -> Events:
        check_window(start, stop)
        first, last = EVER[0] if start is None else start, EVER[1] if stop is None else stop
        columns = self._store.read(self._number, first, last)
        if not self._fits:
            self._store.check_inside(self._number, columns.x, columns.y, columns.p, self._size)
        return Events.trusted(columns, self._size, *bounds_of(start, stop, *self._time))

    def frames(self, start: int | None = None, stop: int | None = None) -> NoReturn:
        raise FormatError(self.path, "a packed store contains only events, no frames")

    def inertial(self, start: int | None = None, stop: int | None = None) -> NoReturn:
        raise FormatError(self.path, "a packed store contains only events, no inertial samples")


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
    """Return whether the arrays of an index have the types and the number of axes that `docs/store.md` states."""
    shapes = {"time": (-1, 2), "size": (-1, 2)}
    fits = all(array.shape[1:] == shapes.get(name, (-1,))[1:] and array.ndim >= 1 for name, array in index.items())
    return fits and all(array.dtype in TYPES.get(name, ("u1",)) for name, array in index.items())


def pack_texts(texts: Iterable[str]) -> np.ndarray:
    """Return strings as bytes: UTF-8, each followed by a zero byte, which no file name contains."""
    return np.frombuffer("".join(text + "\0" for text in texts).encode("utf-8", "surrogatepass"), np.uint8)


def unpack_texts(kept: np.ndarray) -> list[str]:
    """Return the strings that `pack_texts` converted to bytes."""
    return kept.tobytes().decode("utf-8", "surrogatepass").split("\0")[:-1]
