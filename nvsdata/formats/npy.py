"""NumPy arrays of events, `.npy`: records with named fields, or four columns `x y t p` or `x y p t`.

Fields are t (or ts, timestamp), x, y and p (or pol, polarity), in any order and of any numeric type. In columns without
names, polarity is the third or fourth column, whichever contains only -1, 0 and 1; if both do, the order is `x y t p`.
Times with fractions are in seconds, integers in µs. Polarity may be 0/1 or -1/1. nvsdata writes records of x, y, t, p.
"""

from __future__ import annotations

import io
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.lib import format as npy

from nvsdata.common.errors import FormatError
from nvsdata.data.events import LATEST, STRUCTURE, Columns
from nvsdata.data.frame_edges import MICROSECONDS
from nvsdata.formats.contents import Contents
from nvsdata.formats.file_recording import as_integers, as_polarity
from nvsdata.formats.records import Blocks, RecordFile
from nvsdata.formats.registry import Format, starts_with
from nvsdata.formats.writing import Pieces, file_with_header
from nvsdata.kernels.decode.order import is_sorted

NAMES = {"t": ("t", "ts", "timestamp"), "x": ("x",), "y": ("y",), "p": ("p", "pol", "polarity")}
POLARITIES = (-1, 0, 1)


class NpyRecording(RecordFile):
    """A `.npy` file of events; it doesn't state a sensor size."""

    format = "npy"
    block = 4096

    def __init__(self, path: str, sensor_size: tuple[int, int] | None, head: bytes, strict: bool) -> None:
        shape, self._transposed, self._kind, end = header_of(path, head)
        check_events(path, shape, self._kind)
        self.record_size = self._kind.itemsize * (shape[1] if len(shape) == 2 else 1)
        contents = Contents(path, head)
        super().__init__(contents, sensor_size, strict, end)
        lost = shape[0] - self.records
        if lost > 0 and (strict or self._transposed):
            raise FormatError(path, f"truncated: {self.records} of {shape[0]} events are there", offset=contents.size)
        if lost > 0:
            self._repair("events that are cut off", lost)
        self.records = min(self.records, shape[0])
        # the first block is in `head`
        contents.head = head
        first = self._array(0, min(self.records, self.block))
        contents.drop_head()
        self._fields = fields_of(path, first)
        self._scale = time_scale(self._column(first, "t"))

    def _array(self, lo: int, hi: int) -> np.ndarray:
        """Return records lo..hi, [N] with fields or [N, 4]."""
        if self._transposed:
            size, first = (
                self._kind.itemsize,
                [self.header_size + k * self._kind.itemsize * self.records for k in range(4)],
            )
            rows = [self.contents.read(begin + lo * size, begin + hi * size).view(self._kind) for begin in first]
            return np.stack(rows, 1)
        array = self.contents.read(self._byte(lo), self._byte(hi)).view(self._kind)
        return array if self._kind.fields else array.reshape(-1, 4)

    def _column(self, array: np.ndarray, name: str) -> np.ndarray:
        return column_of(array, self._fields[name])

    def _index(self) -> Blocks:
        size = self._kind.itemsize
        if self._transposed:
            begin = self.header_size + int(self._fields["t"]) * size * self.records
            first = self.contents.samples(begin, begin + self.records * size, self.block * size, size).view(self._kind)
            times = self._times(first.reshape(-1))
        else:
            first = self.contents.samples(
                self.header_size, self._byte(self.records), self.block * self.record_size, self.record_size
            ).view(self._kind)
            times = self._times(self._column(first.reshape(-1) if self._kind.fields else first, "t"))
        return Blocks(times, times)

    def _between(self, lo: int, hi: int) -> Columns:
        array = self._array(lo, hi)
        x, y, p = (as_integers(self.path, f"column {name!r}", self._column(array, name)) for name in "xyp")
        t, x, y, p = self._inside((self._times(self._column(array, "t")), x, y, as_polarity(p)), lo)
        return Columns(t, x.astype(np.int16), y.astype(np.int16), p.astype(np.uint8))

    def decode(self) -> Columns:
        columns = self._between(0, self.records)
        self._rises = is_sorted(columns.t)
        if self.strict and not self._rises:
            begins = np.arange(0, self.records, self.block)
            edges = np.minimum.reduceat(columns.t, begins), np.maximum.reduceat(columns.t, begins)
            self._check_blocks(columns.t[begins], *edges)
        return columns

    def _times(self, column: np.ndarray) -> np.ndarray:
        return times_of(self.path, column, self._scale)


def time_scale(t: np.ndarray) -> int:
    """Return the factor from times to µs: times with fractions are in s."""
    return MICROSECONDS if t.dtype.kind == "f" and (t != np.rint(t)).any() else 1


def times_of(path: str, t: np.ndarray, scale: int) -> np.ndarray:
    """Return times in µs, int64. FormatError if they aren't numbers, or beyond 2^62 µs."""
    if scale == 1:
        return as_integers(path, "column 't'", t).astype(np.int64)
    if not (np.abs(t) < LATEST / scale).all():
        raise FormatError(path, "has times that are not numbers, or beyond 2^62 µs")
    # float32 has too few digits for µs
    return np.rint(t.astype(np.float64) * scale).astype(np.int64)


def header_of(path: str, head: bytes) -> tuple[tuple[int, ...], bool, np.dtype[Any], int]:
    """Return an array's shape, whether its columns are stored one after the other, its type, and the data's offset."""
    file = io.BytesIO(head)
    try:
        version = npy.read_magic(file)
        read = npy.read_array_header_1_0 if version == (1, 0) else npy.read_array_header_2_0
        shape, transposed, kind = read(file)
    except Exception as error:  # numpy parses the header as Python, so it may raise anything
        raise FormatError(path, f"damaged header of a NumPy array: {str(error)[:100]}", offset=0) from None
    numbers = [field[0] for field in kind.fields.values()] if kind.fields else [kind]
    if any(number.kind not in "biuf" for number in numbers):
        raise FormatError(path, f"an array of {kind}, not of numbers", offset=0)
    if not shape or not all(0 <= side < 2**48 for side in shape):
        raise FormatError(path, f"an array of shape {shape}", offset=0)
    return shape, transposed and len(shape) == 2, kind, file.tell()


def check_events(path: str, shape: tuple[int, ...], kind: np.dtype[Any]) -> None:
    """Raise FormatError unless an array of this shape can have events."""
    if not (len(shape) == 1 and kind.fields) and not (len(shape) == 2 and shape[1] == 4 and not kind.fields):
        raise FormatError(
            path, f"an array of shape {shape}; events are [N] with fields t, x, y, p, or [N, 4]", offset=0
        )


def column_of(array: np.ndarray, field: str | int) -> np.ndarray:
    """Return a column of records, or of an array [N, 4]."""
    return array[field] if isinstance(field, str) else array[:, field]


def fields_of(path: str, array: np.ndarray) -> dict[str, str | int]:
    """Return field names or column numbers of t, x, y and p, found from the first records."""
    if array.dtype.names is None:
        for names in ("xytp", "xypt"):
            if np.isin(array[:, names.index("p")], POLARITIES).all():
                return {name: k for k, name in enumerate(names)}
        raise FormatError(path, "neither the third nor the fourth column contains only polarities (-1, 0 or 1)")
    found = named(array.dtype.names)
    for name in NAMES:
        if name not in found:
            raise FormatError(path, f"no field {name!r}; the array has {list(array.dtype.names)}")
    return {**found}


def named(given: Iterable[str]) -> dict[str, str]:
    """Return which of the given names are those of t, x, y and p."""
    lower = {name.lower(): name for name in given}
    found = {name: next((lower[key] for key in known if key in lower), None) for name, known in NAMES.items()}
    return {name: field for name, field in found.items() if field is not None}


def write(pieces: Pieces, path: Path) -> None:
    """Write records of x, y (int16), t (int64, µs) and p (uint8), without the sensor size."""
    with file_with_header(path, pieces, _begin) as file:
        for events in pieces:
            file.write(events.to_structured().tobytes())


def _begin(pieces: Pieces) -> bytes:
    file = io.BytesIO()
    # numpy pads the header, so that its length doesn't depend on the number of events
    npy.write_array_header_1_0(file, {"shape": (pieces.count,), "fortran_order": False, "descr": STRUCTURE.descr})
    return file.getvalue()


FORMAT = Format("npy", (".npy",), NpyRecording, begins=starts_with(b"\x93NUMPY"), write=write)
