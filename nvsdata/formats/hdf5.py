"""HDF5: nvsdata's own files, and the layouts of DSEC, of Metavision, and of plain columns.

Our own: `/events/t`, `x`, `y`, `p`, contiguous, so that a window is a slice of a memory map, or in
chunks of 2^18 events if there are more than 2^21 (they are written as they come); `/` has
attributes `format` ("nvsdata-events"), `version`, `width`, `height`. t is uint32 µs, to which `/t_offset` is
added if there is one, or int64 where 71 minutes are not enough; x and y are uint8 where the sensor has at most
256 columns or rows, else int16, and p is uint8: 7 to 9 bytes an event.
Compressed copies (h5repack) are read too, through h5py.

Others: columns x, y, t, p below `/events` or `/`, with `/t_offset`, too (DSEC), or one
compound `/CD/events` (Metavision). Polarity may be 0/1 or -1/1. Their usual compression needs the
package hdf5plugin, which is used if it is installed.
"""

from __future__ import annotations

import math
import mmap
from bisect import bisect_left
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from typing import Any

import h5py
import numpy as np

from nvsdata.errors import FormatError
from nvsdata.events import Columns, check_sensor_size
from nvsdata.events import Recording as BaseRecording
from nvsdata.formats.hdf5_writer import NAME, VERSION, write
from nvsdata.kernels.order import never_falls

__all__ = ["STORE", "Recording", "check_version", "dataset_of", "number_of", "opened", "text_of", "write"]

STORE = "nvsdata-store"
LATEST = 1 << 62  # µs
TYPES = {"t": np.int64, "x": np.int16, "y": np.int16, "p": np.uint8}


class Recording(BaseRecording):
    """An HDF5 file of events."""

    format = "hdf5"

    def __init__(self, path: str, sensor_size: tuple[int, int] | None, head: bytes, strict: bool) -> None:
        super().__init__(path, sensor_size, strict)
        self._offset, self._long = 0, False  # what is added to times, and whether that might take one too far
        with opened(path, "damaged HDF5") as file:
            kind = text_of(file, "format")
            if kind == STORE:
                raise FormatError(path, None, "a packed store of many recordings: open it with its dataset's class")
            if kind == NAME:
                check_version(path, file, VERSION)
            self._size = self._size or self._stated(file, kind == NAME)
            self._columns = self._find(file)
        lengths = {name: column.size for name, column in self._columns.items()}
        if len(set(lengths.values())) != 1:
            raise FormatError(path, None, f"columns of different lengths: {lengths}")

    def _stated(self, file: Any, own: bool) -> tuple[int, int] | None:
        if not own and (_attribute(file, "width") is None or _attribute(file, "height") is None):
            return None
        try:
            return check_sensor_size((number_of(self.path, file, "width"), number_of(self.path, file, "height")))
        except ValueError as error:
            raise FormatError(self.path, None, str(error)) from None

    def _find(self, file: Any) -> dict[str, Column]:
        if "CD/events" in file:
            table = dataset_of(self.path, file, "CD/events")
            kinds = dict(table.dtype.fields or {}) if table.ndim == 1 else {}
            if not all(name in kinds and kinds[name][0].kind in "iub" for name in TYPES):
                raise FormatError(self.path, None, f"/CD/events is {table}, no row of x, y, p and t")
            return {name: Column(self.path, "CD/events", table.size, field=name) for name in TYPES}
        homes = [home for home in map(file.get, ("events", "/")) if isinstance(home, h5py.Group)]
        home = next((home for home in homes if all(name in home for name in TYPES)), None)
        if home is None:
            raise FormatError(self.path, None, "HDF5 without /events/{t,x,y,p}, /{t,x,y,p} or /CD/events")
        memory = _map(self.path)
        # by the lower level of h5py: its datasets take five times as long to open
        datasets = {name: h5py.h5d.open(home.id, name.encode()) for name in TYPES}
        if "t_offset" in file:
            self._offset = self._stated_offset(file["t_offset"])
            self._long = datasets["t"].dtype.itemsize > 4
        return {name: self._column(dataset, memory) for name, dataset in datasets.items()}

    def _stated_offset(self, dataset: Any) -> int:
        value = np.asarray(dataset[()] if isinstance(dataset, h5py.Dataset) else None)
        if value.size == 1 and value.dtype.kind in "iuf" and abs(value.item()) <= LATEST:
            return int(value.item())
        raise FormatError(self.path, None, f"/t_offset is {value}, no time in µs up to 2^62")

    def _column(self, dataset: Any, memory: mmap.mmap) -> Column:
        name, kind = _name(dataset), dataset.dtype
        if dataset.rank != 1 or kind.kind not in "iub":
            raise FormatError(self.path, None, f"{name} is no column of integers")
        (count,) = dataset.shape
        if count == 0:
            return Column(self.path, name, 0)
        places, length = _places(self.path, dataset)
        kind = np.dtype(np.uint8) if kind.kind == "b" else kind
        mapped = []
        for i, place in enumerate(places):
            size = min(length, count - i * length)
            if place + size * kind.itemsize > len(memory):
                raise FormatError(self.path, place, f"truncated within {name}")
            mapped.append(np.frombuffer(memory, kind, size, place))
        return Column(self.path, name, count, mapped)

    def _decode(self) -> Columns:
        return self._slice(0, self._columns["t"].size)

    def _slice(self, lo: int, hi: int) -> Columns:
        raw = {name: self._columns[name].read(slice(lo, hi), np.int64 if name == "t" else None) for name in TYPES}
        t = raw["t"]
        if self._offset and self._long and t.size and not -LATEST <= t.min() <= t.max() <= LATEST:
            raise FormatError(self.path, None, f"times from {t.min()} to {t.max()}: beyond 2^62 µs")
        if raw["p"].dtype.kind == "i":
            raw["p"] = np.where(raw["p"] == -1, 0, raw["p"])
        inside = self._inside([raw[name] for name in TYPES], lo)
        t, x, y, p = (column.astype(kind, copy=False) for column, kind in zip(inside, TYPES.values(), strict=True))
        return Columns(t + self._offset if self._offset else t, x, y, p)

    def _window(self, start: int, stop: int) -> Columns | None:
        """A bisection over t; the slice is checked to be sorted."""
        t = self._columns["t"]
        lo, hi = t.bisect(start - self._offset), t.bisect(stop - self._offset)
        columns = self._slice(lo, max(lo, hi))
        inside = columns.t.size == 0 or (start <= columns.t[0] and columns.t[-1] < stop)
        return columns if inside and never_falls(columns.t) else None

    def _bounds(self) -> tuple[int, int] | None:
        t = self._columns["t"]
        return (int(t[0:1][0]) + self._offset, int(t[t.size - 1 :][0]) + self._offset) if t.size else (0, 0)


@contextmanager
def opened(path: Any, reason: str) -> Iterator[Any]:
    """h5py's file, to read; what goes wrong while it is open is a FormatError that begins with `reason`."""
    try:
        with h5py.File(path, "r") as file:
            yield file
    except FormatError:
        raise
    except (OSError, KeyError, RuntimeError, TypeError, ValueError, MemoryError) as error:
        raise FormatError(path, None, f"{reason}: {error}") from error


def _attribute(file: Any, name: str) -> Any:
    """An attribute of a file, None if it has none; in a third of the time that h5py's own way takes."""
    if not h5py.h5a.exists(file.id, name.encode()):
        return None
    found = h5py.h5a.open(file.id, name.encode())
    if found.shape is None:
        return None
    value = np.empty(found.shape, found.dtype)
    found.read(value)
    return value[()]


def text_of(file: Any, name: str) -> str:
    """An attribute of a file that is a text, empty if it has none."""
    value = _attribute(file, name)
    if isinstance(value, bytes):
        return value.decode("ascii", "replace")
    return "" if value is None else str(value)


def number_of(path: Any, file: Any, name: str) -> Any:
    """An attribute of a file that is a number; FormatError if it has none."""
    value = np.asarray(_attribute(file, name))
    if value.size != 1 or value.dtype.kind not in "iuf":
        raise FormatError(path, None, f"attribute {name} is {value}, no number")
    return value.item()


def check_version(path: Any, file: Any, known: int) -> None:
    """FormatError for a file of a newer version than the one that is known."""
    version = number_of(path, file, "version")
    if version > known:
        raise FormatError(path, None, f"version {version} is newer than {known}: update nvsdata")


def dataset_of(path: Any, file: Any, name: str) -> Any:
    """A dataset of a file, all of whose values are in it; else FormatError."""
    found = file[name]
    if not isinstance(found, h5py.Dataset):
        raise FormatError(path, None, f"{found.name} is no dataset")
    _check_stored(path, found.id)
    return found


def _name(dataset: Any) -> str:
    name: str = h5py.h5i.get_name(dataset).decode("utf-8", "replace")
    return name


def _check_stored(path: Any, dataset: Any) -> None:
    """FormatError if values that a dataset claims aren't in the file: HDF5 would make them up, however many."""
    layout = dataset.get_create_plist()
    claimed = found = 1
    if layout.get_layout() == h5py.h5d.CHUNKED:
        claimed = math.prod(-(-side // chunk) for side, chunk in zip(dataset.shape, layout.get_chunk(), strict=True))
        found = dataset.get_num_chunks()
    elif layout.get_layout() == h5py.h5d.CONTIGUOUS and 0 not in dataset.shape and not layout.get_external_count():
        found = int(dataset.get_offset() is not None)
    if found < claimed:
        what = f"{found} of {claimed} pieces of {_name(dataset)} are there"
        raise FormatError(path, None, f"{what}: cut off, or never written")


def _places(path: str, dataset: Any) -> tuple[list[int], int]:
    """Bytes at which a dataset's values lie as they are, and how many lie together; none if it is compressed."""
    (count,) = dataset.shape
    offset = dataset.get_offset()
    if offset is not None:
        return [offset], count
    _check_stored(path, dataset)
    layout = dataset.get_create_plist()
    if layout.get_layout() != h5py.h5d.CHUNKED or layout.get_nfilters():
        return [], 0
    found: dict[int, int] = {}
    dataset.chunk_iter(lambda chunk: found.update({chunk.chunk_offset[0]: chunk.byte_offset}))
    (length,) = layout.get_chunk()
    return [found[first] for first in range(0, count, length)], length


class Column:
    """A column, `mapped` in equally long parts if it lies in the file as it is; else h5py reads what is asked for."""

    def __init__(
        self, path: str, name: str, size: int, mapped: Sequence[np.ndarray] = (), field: str | None = None
    ) -> None:
        self.path, self.name, self.size, self.mapped, self.field = path, name, int(size), mapped, field

    def __getitem__(self, which: slice) -> np.ndarray:
        return self.read(which)

    def read(self, which: slice, kind: Any = None) -> np.ndarray:
        """A slice, in its own type or another."""
        if self.mapped:
            lo, hi, _ = which.indices(self.size)
            hi, length = max(lo, hi), self.mapped[0].size
            first = min(lo // length, len(self.mapped) - 1)
            parts = self.mapped[first : max((hi - 1) // length, first) + 1]
            cut = [part[max(lo - i * length, 0) : hi - i * length] for i, part in enumerate(parts, first)]
            if len(cut) > 1 and cut[0].dtype != np.uint64:
                return np.concatenate(cut, dtype=kind, casting="unsafe")
            return self._as(kind, cut[0] if len(cut) == 1 else np.concatenate(cut))
        with suppress(ImportError):
            import hdf5plugin  # noqa: F401  registers its filters
        with opened(self.path, f"can't read {self.name}") as file:
            found = file[self.name][which]
        column = np.asarray(found if self.field is None else found[self.field])
        return self._as(kind, column.astype(np.uint8) if column.dtype.kind == "b" else column)

    def _as(self, kind: Any, values: np.ndarray) -> np.ndarray:
        """Values in another type, if `kind` is one."""
        if kind is not None and values.dtype == np.uint64 and values.max(initial=0) > LATEST:
            raise FormatError(self.path, None, f"{self.name} holds {values.max()}: beyond 2^62")
        return values if kind is None else values.astype(kind, copy=False)

    def bisect(self, value: int) -> int:
        """First index whose value is at least `value`; reads one value a step."""
        if self.mapped:
            kind = self.mapped[0].dtype
            if not np.iinfo(kind).min <= value <= np.iinfo(kind).max:
                return 0 if value < np.iinfo(kind).min else self.size
            part = max(bisect_left(self.mapped, value, key=lambda values: int(values[0])) - 1, 0)
            # of the column's own type, or numpy would convert the whole column
            return int(part * self.mapped[0].size + self.mapped[part].searchsorted(kind.type(value), "left"))
        lo, hi = 0, self.size
        while lo < hi:
            middle = (lo + hi) // 2
            if self[middle : middle + 1][0] < value:
                lo = middle + 1
            else:
                hi = middle
        return lo


def _map(path: str) -> mmap.mmap:
    with open(path, "rb") as file:
        # private, not read-only: numba would compile every kernel once more for arrays that can't be written
        return mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_COPY)
