"""HDF5: nvsdata's own files, and the layouts of DSEC, Metavision and plain columns.

nvsdata's own files:

- `/events/t`, `x`, `y`, `p`: contiguous, so that a window is a slice of each; in chunks of 2^18 events if there are
  more than 2^21 events, which are written one chunk after the other. t is uint32 µs, to which `/t_offset` is added if
  it exists, or int64 if 71 minutes aren't enough. x and y are uint8 if the sensor has at most 256 columns or rows,
  otherwise int16. p is uint8. This makes 7 to 9 bytes per event.
- frames and inertial samples: see `nvsdata.formats.hdf5.samples`
- attributes of `/`: `format` ("nvsdata-events"), `version`, `width`, `height`

Compressed files (of the format `hdf5-gzip`, or by h5repack) are read, too. `hdf5-gzip` has chunks of 2^14 events,
shuffled and deflated, and `/events/starts`, the first time of each chunk, int64 µs: a window then reads only its own
chunks. Starts that don't agree with the times that are read are not used.

Other files: columns x, y, t, p in `/events` or `/`, optionally with `/t_offset` (DSEC), or one compound `/CD/events`
(Metavision). An attribute `geometry` states the sensor size, as "1280x720". Polarity may be 0/1 or -1/1. DSEC's
compression needs the package hdf5plugin (`nvsdata[hdf5]`); Metavision's, ECF, is decoded here.

In all layouts except plain columns, times never fall, so a window is found by bisection. A file out of order is
refused, or sorted if `strict` is false. For plain columns, all times are checked before the first window is read.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np

from nvsdata.common.errors import FormatError
from nvsdata.data.events import LATEST, Columns
from nvsdata.data.samples import Frame, Inertial
from nvsdata.formats.contents import Allowance
from nvsdata.formats.file_recording import FileRecording, as_polarity
from nvsdata.formats.hdf5.chunks import values_of
from nvsdata.formats.hdf5.columns import Column, ColumnFile, Stored, bisected, column_of, rises
from nvsdata.formats.hdf5.file import (
    attribute,
    check_version,
    dataset_of,
    found_in,
    number_of,
    opened,
    text_of,
)
from nvsdata.formats.hdf5.samples import about_in, frame_times_in, frames_in, inertial_in
from nvsdata.formats.hdf5.writer import NAME, VERSION
from nvsdata.formats.ondisk import OnDisk
from nvsdata.formats.records import stated_size
from nvsdata.kernels.decode.order import is_sorted

STORE = "nvsdata-store"
TYPES = {"t": np.int64, "x": np.int16, "y": np.int16, "p": np.uint8}
AROUND = 64  # events on each side of a window that are read, too, to check the order of time


class Hdf5Recording(FileRecording):
    """An HDF5 file of events."""

    format = "hdf5"
    holds_samples = True

    def __init__(self, path: str, sensor_size: tuple[int, int] | None, head: bytes, strict: bool) -> None:
        super().__init__(path, sensor_size, strict)
        self._offset = 0  # µs that are added to times
        self._starts: Column | None = None  # first time of each chunk
        self._file = OnDisk(path)
        with opened(path, "damaged HDF5") as file:
            kind = text_of(file, "format")
            if kind == STORE:
                raise FormatError(path, "a packed store of many recordings: open it with its dataset's class")
            if kind == NAME:
                check_version(path, file, VERSION)
            self._size = self._size or self._stated(file, kind == NAME)
            if kind == NAME and attribute(file, "start") is not None:
                self._state_times((number_of(path, file, "start"), number_of(path, file, "end")))
            self._columns = self._find(file, kind == NAME)
            promised = strict and (kind == NAME or self._promises_order(file))
        self._ordered = True if promised else None  # None: unknown
        lengths = {name: column.size for name, column in self._columns.items()}
        if len(set(lengths.values())) != 1:
            raise FormatError(path, f"columns of different lengths: {lengths}")

    def _stated(self, file: Any, own: bool) -> tuple[int, int] | None:
        if not own and (geometry := re.fullmatch(r"([0-9]{1,9})x([0-9]{1,9})", text_of(file, "geometry").strip())):
            return stated_size(self.path, int(geometry[1]), int(geometry[2]))
        if not own and (attribute(file, "width") is None or attribute(file, "height") is None):
            return None
        return stated_size(self.path, number_of(self.path, file, "width"), number_of(self.path, file, "height"))

    def _promises_order(self, file: Any) -> bool:
        """Return whether the layout ensures that times never fall: Metavision's does, and DSEC's with its index."""
        return any(found_in(self.path, file.id, name) is not None for name in ("CD/events", "ms_to_idx"))

    def _find(self, file: Any, own: bool) -> dict[str, Column]:
        if found_in(self.path, file.id, "CD/events") is not None:
            table = dataset_of(self.path, file, "CD/events")
            kinds = dict(table.dtype.fields or {}) if table.ndim == 1 else {}
            if not all(name in kinds and kinds[name][0].kind in "iub" for name in TYPES):
                raise FormatError(self.path, f"/CD/events is {table}, not rows of x, y, p and t")
            return {name: Stored("CD/events", table.size, name) for name in TYPES}
        for home in ("events", ""):
            place = found_in(self.path, file.id, home)
            found = {} if place is None else {name: found_in(self.path, place, name) for name in TYPES}
            if found and None not in found.values():
                break
        else:
            raise FormatError(self.path, "HDF5 without /events/{t,x,y,p}, /{t,x,y,p} or /CD/events")
        if found_in(self.path, file.id, "t_offset") is not None:
            self._offset = self._stated_offset(file)
        left = Allowance(self._file.size)
        columns = {name: column_of(self._file, f"{home}/{name}".lstrip("/"), found[name], left) for name in TYPES}
        if own and (starts := found_in(self.path, place, "starts")) is not None:
            self._starts = column_of(self._file, f"{home}/starts", starts, left)
        return columns

    def _stated_offset(self, file: Any) -> int:
        value = values_of(self.path, dataset_of(self.path, file, "t_offset"))
        if value.size == 1 and value.dtype.kind in "iuf" and abs(value.item()) < LATEST:
            return int(value.item())
        raise FormatError(self.path, f"/t_offset is {value}, not a time in µs below 2^62")

    def decode(self) -> Columns:
        with ColumnFile(self._file) as source:
            t = self._times(source, 0, self._columns["t"].size)
            if self._ordered and not self._rises:
                late = int(np.argmax(t[1:] < t[:-1])) + 1
                raise FormatError(self.path, f"event {late} is earlier than the one before it")
            return self._events(source, 0, t)

    def _events(self, source: ColumnFile, first: int, t: np.ndarray) -> Columns:
        """Return the events from index `first` on, of which the times `t` have been read already."""
        x, y, p = (self._read(source, name, first, first + t.size) for name in "xyp")
        inside = self._inside((t, x, y, as_polarity(p)), first)
        return Columns(*(column.astype(kind, copy=False) for column, kind in zip(inside, TYPES.values(), strict=True)))

    def _read(self, source: ColumnFile, name: str, lo: int, hi: int) -> np.ndarray:
        return self._columns[name].read(source, lo, hi, TYPES[name])

    def _times(self, source: ColumnFile, lo: int, hi: int) -> np.ndarray:
        """Return times lo..hi in µs, int64, and set `_rises`."""
        t = self._read(source, "t", lo, hi)
        ends = [int(t.max(initial=0))] if t.dtype.kind == "u" and t.dtype.itemsize == 8 else []
        if not ends or ends[0] < LATEST - self._offset:
            t = t.astype(np.int64, copy=False)
            self._rises = is_sorted(t)
            ends = [int(end) for end in ((t[0], t[-1]) if self._rises else (t.min(), t.max()))] if t.size else []
        far = next((end for end in ends if not -LATEST < end + self._offset < LATEST), None)
        if far is not None:
            raise FormatError(self.path, f"/{self._columns['t'].name} has the time {far}, at or beyond 2^62 µs")
        if self._offset:
            # in place, because this memory isn't shared
            t += self._offset
        return t

    def decode_window(self, start: int, stop: int) -> Columns | None:
        """Decode a window; return None if the times around it are out of order."""
        with ColumnFile(self._file) as source:
            if not self._in_order(source):
                return None
            chunks = self._chunks(source, start, stop)
            found = self._within(source, start, stop, *chunks) if chunks else None
            return found or self._within(source, start, stop, *self._bisected(source, start, stop))

    def _within(self, source: ColumnFile, start: int, stop: int, first: int, last: int) -> Columns | None:
        """Decode a window from events first..last; None if these are out of order, or may not contain all of it."""
        around = self._times(source, first, last)
        lo, hi = around.searchsorted((start, stop)).tolist()
        if not self._rises or (lo == 0 < first) or (hi == around.size and last < self._columns["t"].size):
            return None
        return self._events(source, first + lo, around[lo:hi])

    def _chunks(self, source: ColumnFile, start: int, stop: int) -> tuple[int, int] | None:
        """Return the range of events in the chunks that overlap a window, by the stored first time of each chunk.

        None if the file has no such times.
        """
        t, starts = self._columns["t"], self._starts
        if starts is None or not isinstance(t, Stored) or not t.chunk or starts.size != -(-t.size // t.chunk):
            return None
        times = starts.read(source, 0, starts.size).astype(np.int64)
        first, last = times.searchsorted((start, stop)).tolist()
        return max(first - 1, 0) * t.chunk, min(last * t.chunk, t.size)

    def _bisected(self, source: ColumnFile, start: int, stop: int) -> tuple[int, int]:
        t = self._columns["t"]
        before, _ = bisected(t, source, start - self._offset)
        _, after = bisected(t, source, stop - self._offset)
        return max(before - AROUND, 0), min(after + AROUND, t.size)

    def _in_order(self, source: ColumnFile) -> bool:
        """Return whether times never fall. Unless the layout ensures it, all times are checked at the first call."""
        if self._ordered is None:
            t = self._columns["t"]
            self._ordered = rises(t, source)
            if self._ordered and t.size:
                edges = self._edges(source)
                if self._begins is not None:
                    self._check_time(*edges)
        return self._ordered

    def _edges(self, source: ColumnFile) -> tuple[int, int]:
        last = self._columns["t"].size - 1
        return int(self._times(source, 0, 1)[0]), int(self._times(source, last, last + 1)[0])

    def decode_span(self) -> tuple[int, int] | None:
        if not self.strict or not self._columns["t"].size:
            return None
        with ColumnFile(self._file) as source:
            return self._edges(source) if self._in_order(source) else None

    def _datasets(self, file: Any) -> Callable[[str], Any]:
        """Return a function that opens datasets by name; all of them share one limit on decompressed bytes."""
        return partial(dataset_of, self.path, file, left=Allowance(self._file.size))

    def frames(self, start: int | None = None, stop: int | None = None) -> Iterator[Frame]:
        with opened(self.path, "damaged /frames") as file:
            yield from frames_in(self.path, file, self._datasets(file), start, stop)

    def inertial(self, start: int | None = None, stop: int | None = None) -> Inertial:
        with opened(self.path, "damaged /inertial") as file:
            return inertial_in(self.path, file, self._datasets(file), start, stop)

    @property
    def about(self) -> dict[str, Any]:
        with opened(self.path, "damaged HDF5") as file:
            times = frame_times_in(self.path, file, self._datasets(file))
            return about_in(partial(text_of, file), partial(attribute, file)) | times
