"""The packed store: all recordings of a dataset in one HDF5 file. Its layout is in `docs/store.md`."""

from __future__ import annotations

import mmap
import zlib
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from nvsdata.datasets.source import Listing
from nvsdata.errors import FormatError
from nvsdata.events import Columns, Recording

NAME, VERSION = "nvsdata-store", 1
COLUMNS = ("t", "x", "y", "p")
INDEX = ("offset", "base", "size", "bytes", "crc", "format", "name", "file_name", "file_offset", "file_data")
KEPT_BYTES = 48 << 20  # of the file that may stay mapped into memory
FAULT_BYTES = 1 << 16  # that the system maps in at once when a column is touched


class Store:
    """A packed store, opened for reading: a `Source` of recordings and side files.

    Cheap to send to workers: what travels is the path, and each process maps the file itself.
    Raises FormatError for a file that is no store, was cut short, is of a newer version, or whose
    index fails its checksum.
    """

    def __init__(self, path: Path) -> None:
        self.root = path
        try:
            with h5py.File(path, "r") as file:
                if file.attrs.get("format") != NAME:
                    raise FormatError(path, None, f"is neither a folder nor a packed store (format {NAME!r})")
                if int(file.attrs["version"]) > VERSION:
                    raise FormatError(
                        path, None, f"version {file.attrs['version']} is newer than {VERSION}: update nvsdata"
                    )
                self.dataset = str(file.attrs["dataset"])
                index = {name: np.asarray(file[f"index/{name}"][()]) for name in INDEX}
                if checksum(index) != int(file.attrs["checksum"]):
                    raise FormatError(path, None, "its index fails its checksum: pack it again")
                self._columns = {name: _place(path, file[f"events/{name}"]) for name in COLUMNS}
        except (OSError, KeyError, RuntimeError) as error:
            raise FormatError(path, None, f"no packed store, or damaged: {error}") from error
        self.offset, self.base, self.sizes = index["offset"], index["base"], index["size"]
        self.bytes, self.crc = index["bytes"], index["crc"]
        self.names = _lines(index["name"])
        self.formats = _lines(index["format"])
        self._number = {name: i for i, name in enumerate(self.names)}
        self._files = {name: i for i, name in enumerate(_lines(index["file_name"]))}
        self._file_offset, self._file_data = index["file_offset"], index["file_data"]
        self._touched = 0
        self._check_lengths()
        self._map = _mapped(path) if any(isinstance(place, tuple) for place in self._columns.values()) else None

    def _check_lengths(self) -> None:
        counts = {len(self.names), len(self.formats), len(self.base), len(self.offset) - 1, len(self.crc)}
        if len(counts) > 1 or (np.diff(self.offset) < 0).any():
            raise FormatError(self.root, None, "its index contradicts itself: pack it again")

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
        return int(self.bytes[self._number[name]])

    def column(self, name: str, lo: int, hi: int) -> np.ndarray:
        """Events lo..hi of a column, as they are stored: a view of the file where it isn't compressed."""
        place = self._columns[name]
        if not isinstance(place, tuple):
            try:
                with h5py.File(self.root, "r") as file:
                    return np.asarray(file[f"events/{name}"][lo:hi])
            except (OSError, KeyError, RuntimeError) as error:
                raise FormatError(self.root, None, f"can't read events {lo} to {hi}: {error}") from error
        kind, start, _ = place
        assert self._map is not None
        self._let_go((hi - lo) * kind.itemsize + FAULT_BYTES)
        return np.frombuffer(self._map, kind, hi - lo, start + lo * kind.itemsize)

    def _let_go(self, touched: int) -> None:
        """Unmap what was read long ago: else a long epoch maps in the whole file."""
        self._touched += touched
        if self._touched > KEPT_BYTES and self._map is not None and hasattr(self._map, "madvise"):
            self._map.madvise(mmap.MADV_DONTNEED)
            self._touched = 0

    def damaged(self, name: str) -> bool:
        """Whether the events of a recording fail their checksum."""
        number = self._number[name]
        lo, hi = int(self.offset[number]), int(self.offset[number + 1])
        return crc_of([self.column(name, lo, hi) for name in COLUMNS]) != int(self.crc[number])


class StoredRecording(Recording):
    """A recording in a store; `format` is that of the file it was packed from."""

    def __init__(self, store: Store, number: int, sensor_size: tuple[int, int] | None) -> None:
        super().__init__(f"{store.root}:{store.names[number]}", sensor_size)
        self._store = store
        self._lo, self._hi = int(store.offset[number]), int(store.offset[number + 1])
        self._base = int(store.base[number])
        self.format = store.formats[number]  # type: ignore[misc]
        if self._size is None:
            width, height = store.sizes[number].tolist()
            self._size = width, height

    def _decode(self) -> Columns:
        return self._slice(self._lo, self._hi)

    def _slice(self, lo: int, hi: int) -> Columns:
        t, x, y, p = (self._store.column(name, lo, hi) for name in COLUMNS)
        return Columns(
            np.add(t, self._base, dtype=np.int64),
            x.astype(np.int16),
            y.astype(np.int16),
            p.astype(np.uint8, copy=False),
        )

    def _window(self, start: int, stop: int) -> Columns | None:
        t = self._store.column("t", self._lo, self._hi)
        most = np.iinfo(t.dtype).max
        a, b = (
            # of the column's own type, or numpy would convert the whole column
            int(t.searchsorted(t.dtype.type(max(time - self._base, 0)))) if time - self._base <= most else t.size
            for time in (start, stop)
        )
        return self._slice(self._lo + a, self._lo + max(a, b))

    def _bounds(self) -> tuple[int, int] | None:
        if self._lo == self._hi:
            return 0, 0
        t = self._store.column("t", self._lo, self._hi)
        return self._base + int(t[0]), self._base + int(t[-1])


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
    """Type, first byte and length of a column that lies in the file as it is; None for a compressed one."""
    offset = dataset.id.get_offset()
    if dataset.size and (dataset.chunks is not None or offset is None):
        return None
    if offset is not None and offset + dataset.nbytes > path.stat().st_size:
        raise FormatError(path, offset, f"cut short within {dataset.name}")
    return dataset.dtype, offset or 0, dataset.size


def _mapped(path: Path) -> mmap.mmap:
    with path.open("rb") as file:
        return mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)


def _lines(packed: np.ndarray) -> list[str]:
    return packed.tobytes().decode("utf-8").split("\n")[:-1]
