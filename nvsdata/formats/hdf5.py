"""nvsdata's own HDF5: one file, `/events/t`, `x`, `y`, `p`, contiguous so that a window is a slice of a memory map.

`/` has attributes `format` ("nvsdata-events"), `version`, `width`, `height`. t is int64 µs, x and
y int16, p uint8. Compressed or chunked copies (h5repack) are read too, through h5py.
"""

from __future__ import annotations

import mmap
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from nvsdata.errors import FormatError
from nvsdata.events import Columns, Events, check_sensor_size
from nvsdata.events import Recording as BaseRecording
from nvsdata.kernels.order import never_falls

NAME, VERSION = "nvsdata-events", 1
TYPES = {"t": np.int64, "x": np.int16, "y": np.int16, "p": np.uint8}


class Recording(BaseRecording):
    """An HDF5 file of events."""

    format = "hdf5"

    def __init__(self, path: str, sensor_size: tuple[int, int] | None, head: bytes) -> None:
        super().__init__(path, sensor_size)
        try:
            with h5py.File(path, "r") as file:
                self._size = self._size or self._attributes(file)
                memory = _map(path)
                self._columns = {name: self._column(file, name, memory) for name in TYPES}
        except (OSError, KeyError, RuntimeError) as error:
            raise FormatError(path, None, f"damaged HDF5: {error}") from error
        lengths = {name: len(column) for name, column in self._columns.items()}
        if len(set(lengths.values())) != 1:
            raise FormatError(path, None, f"columns of different lengths: {lengths}")

    def _attributes(self, file: Any) -> tuple[int, int]:
        if file.attrs.get("format") != NAME:
            raise FormatError(self.path, None, f"HDF5 without the attribute format = {NAME!r}")
        if int(file.attrs["version"]) > VERSION:
            raise FormatError(
                self.path, None, f"version {file.attrs['version']} is newer than {VERSION}: update nvsdata"
            )
        try:
            return check_sensor_size((file.attrs["width"], file.attrs["height"]))
        except ValueError as error:
            raise FormatError(self.path, None, str(error)) from None

    def _column(self, file: Any, name: str, memory: mmap.mmap) -> np.ndarray:
        dataset = file[f"events/{name}"]
        if dataset.ndim != 1 or dataset.dtype.kind not in "iu":
            raise FormatError(self.path, None, f"/events/{name} is no column of integers")
        offset = dataset.id.get_offset()
        if offset is None or dataset.size == 0:
            return np.asarray(dataset[:])
        if offset + dataset.nbytes > len(memory):
            raise FormatError(self.path, offset, f"truncated within /events/{name}")
        return np.frombuffer(memory, dataset.dtype, dataset.size, offset)

    def _decode(self) -> Columns:
        return self._slice(0, len(self._columns["t"]))

    def _slice(self, lo: int, hi: int) -> Columns:
        t, x, y, p = (np.asarray(self._columns[name][lo:hi]).astype(kind, copy=False) for name, kind in TYPES.items())
        width, height = self.sensor_size
        bad = (x < 0) | (y < 0) | (x >= width) | (y >= height) | (p > 1)
        if bad.any():
            first = lo + int(np.argmax(bad))
            raise FormatError(self.path, None, f"event {first}: outside the sensor of {width}x{height}, or no polarity")
        return Columns(t, x, y, p)

    def _window(self, start: int, stop: int) -> Columns | None:
        """A bisection over t; events of our files are sorted, and the slice is checked to be."""
        t = self._columns["t"]
        columns = self._slice(int(np.searchsorted(t, start, "left")), int(np.searchsorted(t, stop, "left")))
        return columns if never_falls(columns.t) else None

    def _bounds(self) -> tuple[int, int] | None:
        t = self._columns["t"]
        return (int(t[0]), int(t[-1])) if len(t) else (0, 0)


def _map(path: str) -> mmap.mmap:
    with open(path, "rb") as file:
        return mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)


def write(events: Events, path: Path) -> None:
    """Write the four columns, contiguous and uncompressed."""
    with h5py.File(path, "w") as file:
        file.attrs.update(format=NAME, version=VERSION, width=events.sensor_size[0], height=events.sensor_size[1])
        for name, column in events.columns._asdict().items():
            file.create_dataset(f"events/{name}", data=column, dtype=TYPES[name])
