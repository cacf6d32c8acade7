"""The packed store: all recordings of a dataset in one HDF5 file. Its layout is in `docs/store.md`."""

from __future__ import annotations

import os
import zlib
from pathlib import Path
from typing import Any

import numpy as np

from nvsdata.datasets.source import Listing
from nvsdata.errors import FormatError
from nvsdata.events import EVER, Columns, Recording
from nvsdata.formats.hdf5 import STORE, check_version, dataset_of, number_of, opened, text_of
from nvsdata.kernels.store import marked_range, read_window, stored_window

VERSION = 1
COLUMNS = ("t", "x", "y", "p")
INDEX = (
    "offset",
    "base",
    "duration",
    "mark",
    "size",
    "bytes",
    "crc",
    "format",
    "name",
    "file_name",
    "file_offset",
    "file_data",
)
MARKED = 256  # events from one time in the index to the next


class Store:
    """A packed store, opened for reading: a `Source` of recordings and side files.

    Cheap to send to workers: what travels is the path, and each process maps the file itself.
    Raises FormatError for a file that is no store, was cut short, is of a newer version, or whose
    index fails its checksum.
    """

    def __init__(self, path: Path) -> None:
        self.root, self.path = path, str(path)
        with opened(path, "no packed store, or damaged") as file:
            if text_of(file, "format") != STORE:
                raise FormatError(path, None, f"is neither a folder nor a packed store (format {STORE!r})")
            check_version(path, file, VERSION)
            self.dataset = text_of(file, "dataset")
            index = {name: np.asarray(dataset_of(path, file, f"index/{name}")[()]) for name in INDEX}
            if checksum(index) != number_of(path, file, "checksum"):
                raise FormatError(path, None, "its index fails its checksum: pack it again")
            places = {name: _place(path, dataset_of(path, file, f"events/{name}")) for name in COLUMNS}
        first_mark = np.concatenate(([0], np.cumsum(-(-np.diff(index["offset"]) // MARKED))))
        # lists, for a number out of an array costs as much as all the rest of a look-up
        self._offset, self._base, self._duration = (index[name].tolist() for name in ("offset", "base", "duration"))
        self._first_mark = first_mark.tolist()
        self._sizes, self._sources, self._crc = index["size"], index["bytes"], index["crc"]
        self.names = _lines(index["name"])
        self.formats = _lines(index["format"])
        self._number = {name: i for i, name in enumerate(self.names)}
        self._files = {name: i for i, name in enumerate(_lines(index["file_name"]))}
        self._file_offset, self._file_data = index["file_offset"], index["file_data"]
        self._marks = index["mark"]
        counts = {len(self.names), len(self.formats), len(self._base), len(self._offset) - 1, len(self._crc)}
        if len(counts) > 1 or (np.diff(index["offset"]) < 0).any() or first_mark[-1] != len(self._marks):
            raise FormatError(path, None, "its index contradicts itself: pack it again")
        # None for compressed columns
        self._places = [place for place in places.values() if place is not None]
        # what `read_window` is told of them, where it can read
        begins, like = [begin for *_, begin in self._places], [np.empty(0, kind) for kind, *_ in self._places]
        self._direct = (*begins, *like) if len(like) == len(COLUMNS) and hasattr(os, "pread") else ()
        self._file = path.open("rb", buffering=0)
        self._handle = self._file.fileno()

    def __reduce__(self) -> tuple[type, tuple[Path]]:
        return Store, (self.root,)

    def listing(self) -> Listing:
        """The files that were packed, and the side files."""
        found: Listing = {}
        for name in (*self.names, *self._files):
            folder, _, file = name.rpartition("/")
            found.setdefault(folder or ".", []).append(file)
        return {folder: sorted(found[folder]) for folder in sorted(found)}

    def open(self, name: str, sensor_size: tuple[int, int] | None) -> StoredRecording:
        """The recording of that name."""
        return StoredRecording(self, self._number[name], sensor_size)

    def data(self, name: str) -> bytes:
        """The bytes of a side file."""
        i = self._files[name]
        return self._file_data[self._file_offset[i] : self._file_offset[i + 1]].tobytes()

    def size(self, name: str) -> int:
        """Bytes of the file that the recording was packed from."""
        return int(self._sources[self._number[name]])

    def read(self, number: int, start: int, stop: int, bottom: int = -1) -> Columns:
        """Events of a recording with start <= t < stop: a bisection of the index, then its part of each column.

        y is counted from row `bottom` up if that isn't negative.
        """
        lo, hi, base = self._offset[number], self._offset[number + 1], self._base[number]
        marks = self._marks[self._first_mark[number] : self._first_mark[number + 1]]
        first, last = marked_range(marks, base, start, stop)
        lo, hi = lo + first * MARKED, min(lo + last * MARKED, hi)
        columns = Columns.room(max(hi - lo, 0))
        count = -1
        if self._direct:
            count = read_window(*columns, base, start, stop, bottom, self._handle, lo, *self._direct)
        if count < 0:
            # or the error that tells why there are fewer bytes
            count = stored_window(*columns, base, start, stop, bottom, *self._raw(lo, max(lo, hi)))
        return columns.first(count)

    def span(self, number: int) -> tuple[int, int]:
        """Times of the first and the last event of a recording."""
        base: int = self._base[number]
        return base, base + self._duration[number]

    def sensor_size(self, number: int) -> tuple[int, int]:
        """(width, height) of a recording, as it was packed."""
        width, height = self._sizes[number].tolist()
        return width, height

    def _raw(self, lo: int, hi: int) -> list[np.ndarray]:
        """Events lo..hi as they are stored.

        Read rather than mapped: a page that is mapped in costs more than its bytes, and stays.
        """
        if len(self._places) == len(COLUMNS):
            n = hi - lo
            return [np.frombuffer(self._bytes(n * size, begin + lo * size), kind) for kind, size, begin in self._places]
        with opened(self.root, f"can't read events {lo} to {hi}") as file:
            return [np.asarray(file[f"events/{name}"][lo:hi]) for name in COLUMNS]

    def _bytes(self, size: int, at: int) -> bytes:
        """Bytes of the file, read without a position that forked workers would share."""
        data = _pread(self._handle, size, at)
        while len(data) < size:
            # the system hands out 2 GiB at most at a time
            more = _pread(self._handle, size - len(data), at + len(data))
            if not more:
                raise FormatError(self.root, at + len(data), "cut short while it was open")
            data += more
        return data

    def damaged(self, name: str) -> bool:
        """Whether the events of a recording fail their checksum."""
        number = self._number[name]
        return crc_of(self._raw(self._offset[number], self._offset[number + 1])) != int(self._crc[number])


class StoredRecording(Recording):
    """A recording in a store."""

    def __init__(self, store: Store, number: int, sensor_size: tuple[int, int] | None) -> None:
        # by hand, not by the base's method: this is much of what a window costs
        self._store, self._number = store, number
        self.strict, self.repairs, self._whole = True, {}, None
        self._size = store.sensor_size(number) if sensor_size is None else sensor_size
        self._bottom = -1

    def upright(self) -> StoredRecording:
        """Itself, from now on with y counted from the bottom of the sensor up."""
        self._bottom = self.sensor_size[1] - 1
        return self

    @property
    def path(self) -> str:  # type: ignore[override]
        """The store's, and the recording's name."""
        return f"{self._store.path}:{self._store.names[self._number]}"

    @property
    def format(self) -> str:  # type: ignore[override]
        """That of the file it was packed from."""
        return self._store.formats[self._number]

    def _decode(self) -> Columns:
        return self._store.read(self._number, *EVER, self._bottom)

    def _window(self, start: int, stop: int) -> Columns | None:
        return self._store.read(self._number, start, stop, self._bottom)

    def _bounds(self) -> tuple[int, int] | None:
        return self._store.span(self._number)


def checksum(index: dict[str, np.ndarray]) -> int:
    """CRC-32 over the arrays of the index, in the order of `INDEX`."""
    return crc_of([index[name] for name in INDEX])


def crc_of(arrays: list[np.ndarray]) -> int:
    """CRC-32 over the bytes of arrays, one after the other."""
    value = 0
    for array in arrays:
        value = zlib.crc32(np.ascontiguousarray(array).data.cast("B") if array.size else b"", value)
    return value


def _place(path: Path, dataset: Any) -> tuple[np.dtype[Any], int, int] | None:
    """Type, its size and first byte of a column that lies in the file as it is; None for a compressed one."""
    offset = dataset.id.get_offset()
    if dataset.size and (dataset.chunks is not None or offset is None):
        return None
    if offset is not None and offset + dataset.nbytes > path.stat().st_size:
        raise FormatError(path, offset, f"cut short within {dataset.name}")
    return dataset.dtype, dataset.dtype.itemsize, offset or 0


def _seek_and_read(handle: int, size: int, at: int) -> bytes:
    os.lseek(handle, at, os.SEEK_SET)
    return os.read(handle, size)


# where there is no pread (Windows), there is no fork either
_pread = getattr(os, "pread", _seek_and_read)


def _lines(packed: np.ndarray) -> list[str]:
    return packed.tobytes().decode("utf-8").split("\n")[:-1]
