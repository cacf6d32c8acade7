"""HDF5: nvsdata's own files, and the layouts of DSEC, of Metavision, and of plain columns.

Our own: `/events/t`, `x`, `y`, `p`, contiguous, so that a window is a slice of a memory map, or in
chunks of 2^18 events if there are more than 2^21 (they are written as they come); `/` has
attributes `format` ("nvsdata-events"), `version`, `width`, `height`. t is uint32 µs, to which `/t_offset` is
added if there is one, or int64 where 71 minutes are not enough; x and y are int16, p uint8: 9 bytes an event.
Compressed copies (h5repack) are read too, through h5py.

Others: columns x, y, t, p below `/events` or `/`, with `/t_offset`, too (DSEC), or one
compound `/CD/events` (Metavision). Polarity may be 0/1 or -1/1. Their usual compression needs the
package hdf5plugin, which is used if it is installed.
"""

from __future__ import annotations

import mmap
from bisect import bisect_left
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from itertools import chain, islice
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from nvsdata.errors import FormatError
from nvsdata.events import Columns, Events, check_sensor_size, joined
from nvsdata.events import Recording as BaseRecording
from nvsdata.files import flushed_early
from nvsdata.kernels.order import never_falls

NAME, VERSION = "nvsdata-events", 1
CHUNK = 1 << 18  # events of a piece of a long file
CONTIGUOUS = 8  # pieces up to which a file's columns are kept in memory and written whole
STORE = "nvsdata-store"
# the newer layout has checksums, and texts of fixed length need no heap: the library loops on some damaged ones
WRITING: dict[str, Any] = {"libver": ("v110", "latest")}
SHORT = 1 << 32  # µs that uint32 can tell apart
LATEST = 1 << 62  # µs
TYPES = {"t": np.int64, "x": np.int16, "y": np.int16, "p": np.uint8}


class Recording(BaseRecording):
    """An HDF5 file of events."""

    format = "hdf5"

    def __init__(self, path: str, sensor_size: tuple[int, int] | None, head: bytes, strict: bool) -> None:
        super().__init__(path, sensor_size, strict)
        self._offset, self._long = 0, False  # what is added to times, and whether that might take one too far
        try:
            with h5py.File(path, "r") as file:
                own = text_of(file, "format") == NAME
                if text_of(file, "format") == STORE:
                    raise FormatError(path, None, "a packed store of many recordings: open it with its dataset's class")
                if own and int(file.attrs["version"]) > VERSION:
                    reason = f"version {file.attrs['version']} is newer than {VERSION}: update nvsdata"
                    raise FormatError(path, None, reason)
                self._size = self._size or self._stated(file, own)
                self._columns = self._find(file)
        except (OSError, KeyError, RuntimeError) as error:
            raise FormatError(path, None, f"damaged HDF5: {error}") from error
        lengths = {name: column.size for name, column in self._columns.items()}
        if len(set(lengths.values())) != 1:
            raise FormatError(path, None, f"columns of different lengths: {lengths}")

    def _stated(self, file: Any, own: bool) -> tuple[int, int] | None:
        if not own and not {"width", "height"} <= set(file.attrs):
            return None
        try:
            return check_sensor_size((file.attrs["width"], file.attrs["height"]))
        except ValueError as error:
            raise FormatError(self.path, None, str(error)) from None

    def _find(self, file: Any) -> dict[str, Column]:
        if "CD/events" in file:
            table = file["CD/events"]
            if table.dtype.names is None or set(TYPES) - set(table.dtype.names):
                raise FormatError(self.path, None, f"/CD/events holds {table.dtype}, not x, y, p and t")
            return {name: Column(self.path, "CD/events", table.size, field=name) for name in TYPES}
        home = next((home for home in ("events", "/") if home in file and set(TYPES) <= set(file[home])), None)
        if home is None:
            raise FormatError(self.path, None, "HDF5 without /events/{t,x,y,p}, /{t,x,y,p} or /CD/events")
        if "t_offset" in file:
            self._offset = self._stated_offset(file["t_offset"])
            self._long = file[home]["t"].dtype.itemsize > 4
        memory = _map(self.path)
        return {name: self._column(file[home], name, memory) for name in TYPES}

    def _stated_offset(self, dataset: Any) -> int:
        value = np.asarray(dataset[()] if isinstance(dataset, h5py.Dataset) else None)
        if value.size == 1 and value.dtype.kind in "iuf" and abs(value.item()) <= LATEST:
            return int(value.item())
        raise FormatError(self.path, None, f"/t_offset is {value}, no time in µs up to 2^62")

    def _column(self, group: Any, name: str, memory: mmap.mmap) -> Column:
        dataset = group[name]
        if dataset.ndim != 1 or dataset.dtype.kind not in "iub":
            raise FormatError(self.path, None, f"{dataset.name} is no column of integers")
        if dataset.size == 0:
            return Column(self.path, dataset.name, 0)
        places, length = _places(dataset)
        kind = np.dtype(np.uint8) if dataset.dtype.kind == "b" else dataset.dtype
        mapped = []
        for i, place in enumerate(places):
            size = min(length, dataset.size - i * length)
            if place + size * kind.itemsize > len(memory):
                raise FormatError(self.path, place, f"truncated within {dataset.name}")
            mapped.append(np.frombuffer(memory, kind, size, place))
        return Column(self.path, dataset.name, dataset.size, mapped)

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


def text_of(file: Any, name: str) -> str:
    """An attribute of a file, empty if it has none."""
    value = file.attrs.get(name, b"")
    return value.decode("ascii", "replace") if isinstance(value, bytes) else str(value)


def _places(dataset: Any) -> tuple[list[int], int]:
    """Bytes at which a dataset's values lie as they are, and how many lie together; none if it is compressed."""
    offset = dataset.id.get_offset()
    if offset is not None:
        return [offset], dataset.size
    if dataset.chunks is None or dataset.id.get_create_plist().get_nfilters():
        return [], 0
    found: dict[int, int] = {}
    dataset.id.chunk_iter(lambda chunk: found.update({chunk.chunk_offset[0]: chunk.byte_offset}))
    length = dataset.chunks[0]
    wanted = range(0, dataset.size, length)
    return ([found[first] for first in wanted], length) if set(wanted) <= set(found) else ([], 0)


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
        try:
            with h5py.File(self.path, "r") as file:
                found = file[self.name][which]
        except (OSError, KeyError, RuntimeError) as error:
            raise FormatError(self.path, None, f"can't read {self.name}: {error}") from error
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


def write(pieces: Iterable[Events], sensor_size: tuple[int, int], path: Path) -> None:
    """Write the four columns: contiguous if they are short, else in chunks as they come; never compressed."""
    chunks = _of_one_size(pieces)
    waiting = list(islice(chunks, CONTIGUOUS + 1)) or [Columns.room(0)]
    kind, offset = _clock(waiting)
    with h5py.File(path, "w", **WRITING) as file:
        file.attrs.update(format=np.bytes_(NAME), version=VERSION, width=sensor_size[0], height=sensor_size[1])
        if len(waiting) > CONTIGUOUS:
            with flushed_early(path):
                offset = _write_chunks(file, chain(waiting, chunks), kind, offset)
        else:
            columns = joined(waiting)
            for name, column in zip(TYPES, (_since(columns.t, offset, kind), *columns[1:]), strict=True):
                file.create_dataset(f"events/{name}", data=column)
        if offset:
            file["t_offset"] = np.int64(offset)


def _clock(pieces: Sequence[Columns]) -> tuple[Any, int]:
    """Type in which these times are stored, and what is taken off them; 0 where that will do."""
    if pieces[-1].t.size == 0:
        return np.uint32, 0
    first, last = int(pieces[0].t[0]), int(pieces[-1].t[-1])
    if first >= 0 and last < SHORT:
        return np.uint32, 0
    return (np.uint32, first) if last - first < SHORT else (np.int64, 0)


def _since(t: np.ndarray, offset: int, kind: Any) -> np.ndarray:
    return (t - offset if offset else t).astype(kind, copy=False)


def _write_chunks(file: Any, pieces: Iterable[Columns], kind: Any, offset: int) -> int:
    """Write pieces of `CHUNK` events; what is taken off the times in the end."""
    datasets = {name: _endless(file, name, kind if name == "t" else TYPES[name]) for name in TYPES}
    count = 0
    for piece in pieces:
        if kind == np.uint32 and int(piece.t[-1]) - offset >= SHORT:
            datasets["t"] = _widened(file, offset)
            kind, offset = np.int64, 0
        for values, dataset in zip((_since(piece.t, offset, kind), *piece[1:]), datasets.values(), strict=True):
            dataset.resize((count + values.size,))
            # past the library's own path, which would copy
            whole = (
                values
                if values.size == CHUNK
                else np.concatenate((values, np.zeros(CHUNK - values.size, values.dtype)))
            )
            dataset.id.write_direct_chunk((count,), np.ascontiguousarray(whole))
        count += piece.t.size
    return offset


def _endless(file: Any, name: str, kind: Any) -> Any:
    return file.create_dataset(f"events/{name}", (0,), kind, maxshape=(None,), chunks=(CHUNK,), fillvalue=0)


def _widened(file: Any, offset: int) -> Any:
    """The column of times in int64: the recording takes longer than uint32 can tell."""
    narrow, wide = file["events/t"], _endless(file, "wide", np.int64)
    wide.resize(narrow.shape)
    for start in range(0, narrow.size, CHUNK):
        wide[start : start + CHUNK] = narrow[start : start + CHUNK].astype(np.int64) + offset
    del file["events/t"]
    file.move("events/wide", "events/t")
    return wide


def _of_one_size(pieces: Iterable[Events]) -> Iterator[Columns]:
    """The same events in pieces of `CHUNK`, only the last one shorter."""
    room, filled = Columns.room(CHUNK), 0
    for piece in pieces:
        rest = piece.columns
        while rest.t.size:
            part = rest.first(CHUNK - filled)
            rest = rest.at(slice(part.t.size, None))
            if part.t.size == CHUNK:
                yield part
                continue
            for values, place in zip(part, room, strict=True):
                place[filled : filled + values.size] = values
            filled += part.t.size
            if filled == CHUNK:
                yield room
                room, filled = Columns.room(CHUNK), 0
    if filled:
        yield room.first(filled)
