"""NumPy arrays of events, `.npy`: records with named fields, or four columns `x y t p` or `x y p t`.

Fields are t (or ts, timestamp), x, y and p (or pol, polarity), in any order and of any number type. Of columns without
names the polarity is the one that holds -1, 0 and 1 only, p rather than t where both do. Times that are not whole are
seconds, others µs; polarity may be 0/1 or -1/1. We write records of x, y, t and p.
"""

from __future__ import annotations

import io
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.lib import format as npy

from nvsdata.errors import FormatError
from nvsdata.events import STRUCTURE, Columns, Events
from nvsdata.formats.records import Blocks, RecordFile
from nvsdata.frames import MICROSECONDS

NAMES = {"t": ("t", "ts", "timestamp"), "x": ("x",), "y": ("y",), "p": ("p", "pol", "polarity")}
POLARITIES = (-1, 0, 1)
MOST = 2**62  # µs


class Recording(RecordFile):
    """A `.npy` file of events; it holds no sensor size."""

    format = "npy"
    block = 4096

    def __init__(self, path: str, sensor_size: tuple[int, int] | None, head: bytes, strict: bool) -> None:
        shape, transposed, kind, end = _header(path, head)
        self.record_size = kind.itemsize * (shape[1] if len(shape) == 2 else 1)
        super().__init__(path, sensor_size, head, strict, end)
        lost = shape[0] - self.records
        if lost > 0 and (strict or transposed):
            raise FormatError(path, len(self._raw) + end, f"truncated: {shape[0]} events, {self.records} are there")
        if lost > 0:
            self._repair("events that are cut off", lost)
        self._raw = self._raw[: shape[0] * self.record_size]
        array = self._raw.view(kind)
        if len(shape) == 2:
            array = array.reshape(4, -1).T if transposed else array.reshape(-1, 4)
        self._columns = _columns(path, array)
        first = self._columns["t"][: self.block]
        self._scale = MICROSECONDS if first.dtype.kind == "f" and (first != np.rint(first)).any() else 1

    def _index(self) -> Blocks:
        times = self._times(self._columns["t"][:: self.block])
        return Blocks(times, np.zeros_like(times))

    def _records(self, lo: int, hi: int, offset: int) -> tuple[Columns, int]:
        x, y, p = (self._whole_numbers(name, self._columns[name][lo:hi]) for name in "xyp")
        t, x, y, p = self._inside((self._times(self._columns["t"][lo:hi]), x, y, np.where(p == -1, 0, p)), lo)
        return Columns(t, x.astype(np.int16), y.astype(np.int16), p.astype(np.uint8)), -1

    def _times(self, column: np.ndarray) -> np.ndarray:
        if self._scale == 1:
            return self._whole_numbers("t", column)
        if not (np.abs(column) < MOST / self._scale).all():
            raise FormatError(self.path, None, "holds times that are no numbers, or beyond 2^62 µs")
        # float32 has too few digits for what comes
        return np.rint(column.astype(np.float64) * self._scale).astype(np.int64)

    def _whole_numbers(self, name: str, column: np.ndarray) -> np.ndarray:
        # NaN fails the comparison, too
        if column.dtype.kind == "f" and not ((np.abs(column) < MOST) & (column == np.rint(column))).all():
            raise FormatError(self.path, None, f"column {name!r} holds numbers that aren't whole")
        if column.dtype.itemsize == 8 and column.size and not -MOST < column.min() <= column.max() < MOST:
            raise FormatError(self.path, None, f"column {name!r} holds numbers beyond 2^62")
        return column.astype(np.int64)


def _header(path: str, head: bytes) -> tuple[tuple[int, ...], bool, np.dtype[Any], int]:
    """Shape, whether columns lie one after the other, type, and the byte where the data begin."""
    file = io.BytesIO(head)
    try:
        version = npy.read_magic(file)
        read = npy.read_array_header_1_0 if version == (1, 0) else npy.read_array_header_2_0
        shape, transposed, kind = read(file)
    except Exception as error:  # numpy parses it as Python, and fails in as many ways
        raise FormatError(path, 0, f"damaged header of a NumPy array: {str(error)[:100]}") from None
    numbers = kind.fields or {"": (kind, 0)}
    if any(field[0].kind not in "biuf" for field in numbers.values()):
        raise FormatError(path, 0, f"an array of {kind}, not of numbers")
    if not (len(shape) == 1 and kind.fields) and not (len(shape) == 2 and shape[1] == 4 and not kind.fields):
        raise FormatError(path, 0, f"an array of shape {shape}; events are [N] with fields t, x, y, p, or [N, 4]")
    if not 0 <= shape[0] < 2**48:
        raise FormatError(path, 0, f"an array of shape {shape}")
    return shape, transposed and len(shape) == 2, kind, file.tell()


def _columns(path: str, array: np.ndarray) -> dict[str, np.ndarray]:
    """The columns by name, views of `array`."""
    if array.dtype.names is None:
        head = array[: Recording.block]
        for names in ("xytp", "xypt"):
            if np.isin(head[:, names.index("p")], POLARITIES).all():
                return {name: array[:, k] for k, name in enumerate(names)}
        raise FormatError(path, None, "neither the third nor the fourth column is of polarities: -1, 0 or 1")
    given = {name.lower(): name for name in array.dtype.names}
    found = {}
    for name, known in NAMES.items():
        field = next((given[key] for key in known if key in given), None)
        if field is None:
            raise FormatError(path, None, f"no field {name!r}; it holds {list(array.dtype.names)}")
        found[name] = array[field]
    return found


def write(pieces: Iterable[Events], sensor_size: tuple[int, int], path: Path) -> None:
    """Write records of x, y (int16), t (int64, µs) and p (uint8); the sensor size is not kept."""
    count = 0
    with path.open("wb") as file:
        _begin(file, count)
        for events in pieces:
            file.write(events.to_structured().tobytes())
            count += len(events)
        # the header leaves room for any number
        file.seek(0)
        _begin(file, count)


def _begin(file: Any, count: int) -> None:
    npy.write_array_header_1_0(file, {"shape": (count,), "fortran_order": False, "descr": STRUCTURE.descr})
