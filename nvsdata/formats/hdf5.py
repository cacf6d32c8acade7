"""HDF5: nvsdata's own files, and the layouts of DSEC, of Metavision, and of plain columns.

Our own: `/events/t`, `x`, `y`, `p`, contiguous, so that a window is a slice of a memory map; `/` has
attributes `format` ("nvsdata-events"), `version`, `width`, `height`. t is int64 µs, x and y int16,
p uint8. Compressed or chunked copies (h5repack) are read too, through h5py.

Others: columns x, y, t, p below `/events` or `/`, where `/t_offset` is added to t (DSEC), or one
compound `/CD/events` (Metavision). Polarity may be 0/1 or -1/1. Their usual compression needs the
package hdf5plugin, which is used if it is installed.
"""

from __future__ import annotations

import mmap
from contextlib import suppress
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from nvsdata.errors import FormatError
from nvsdata.events import Columns, Events, check_sensor_size
from nvsdata.events import Recording as BaseRecording
from nvsdata.kernels.order import never_falls

NAME, VERSION = "nvsdata-events", 1
STORE = "nvsdata-store"
# the newer layout has checksums, and texts of fixed length need no heap: the library loops on some damaged ones
WRITING: dict[str, Any] = {"libver": ("v110", "latest")}
TYPES = {"t": np.int64, "x": np.int16, "y": np.int16, "p": np.uint8}


class Recording(BaseRecording):
    """An HDF5 file of events."""

    format = "hdf5"

    def __init__(self, path: str, sensor_size: tuple[int, int] | None, head: bytes, strict: bool) -> None:
        super().__init__(path, sensor_size, strict)
        self._offset = 0
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
            self._offset = int(file["t_offset"][()])
        memory = _map(self.path)
        return {name: self._column(file[home], name, memory) for name in TYPES}

    def _column(self, group: Any, name: str, memory: mmap.mmap) -> Column:
        dataset = group[name]
        if dataset.ndim != 1 or dataset.dtype.kind not in "iub":
            raise FormatError(self.path, None, f"{dataset.name} is no column of integers")
        offset = dataset.id.get_offset()
        if offset is None or dataset.size == 0:
            return Column(self.path, dataset.name, dataset.size)
        if offset + dataset.nbytes > len(memory):
            raise FormatError(self.path, offset, f"truncated within {dataset.name}")
        kind = np.uint8 if dataset.dtype.kind == "b" else dataset.dtype
        return Column(self.path, dataset.name, dataset.size, np.frombuffer(memory, kind, dataset.size, offset))

    def _decode(self) -> Columns:
        return self._slice(0, self._columns["t"].size)

    def _slice(self, lo: int, hi: int) -> Columns:
        raw = {name: self._columns[name][lo:hi] for name in TYPES}
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


class Column:
    """A column, in memory where it lies in the file as it is; otherwise h5py reads the slices asked for."""

    def __init__(
        self, path: str, name: str, size: int, mapped: np.ndarray | None = None, field: str | None = None
    ) -> None:
        self.path, self.name, self.size, self.mapped, self.field = path, name, int(size), mapped, field

    def __getitem__(self, which: slice) -> np.ndarray:
        if self.mapped is not None:
            return self.mapped[which]
        with suppress(ImportError):
            import hdf5plugin  # noqa: F401  registers its filters
        try:
            with h5py.File(self.path, "r") as file:
                found = file[self.name][which]
        except (OSError, KeyError, RuntimeError) as error:
            raise FormatError(self.path, None, f"can't read {self.name}: {error}") from error
        column = np.asarray(found if self.field is None else found[self.field])
        return column.astype(np.uint8) if column.dtype.kind == "b" else column

    def bisect(self, value: int) -> int:
        """First index whose value is at least `value`; reads one value a step."""
        if self.mapped is not None:
            kind = np.iinfo(self.mapped.dtype)
            if not kind.min <= value <= kind.max:
                return 0 if value < kind.min else self.size
            # of the column's own type, or numpy would convert the whole column
            return int(self.mapped.searchsorted(self.mapped.dtype.type(value), "left"))
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
        return mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)


def write(events: Events, path: Path) -> None:
    """Write the four columns, contiguous and uncompressed."""
    with h5py.File(path, "w", **WRITING) as file:
        file.attrs.update(
            format=np.bytes_(NAME), version=VERSION, width=events.sensor_size[0], height=events.sensor_size[1]
        )
        for name, column in events.columns._asdict().items():
            file.create_dataset(f"events/{name}", data=column, dtype=TYPES[name])
