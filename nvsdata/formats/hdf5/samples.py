"""Frames, inertial samples and metadata in nvsdata's HDF5 files.

- `/frames`: `start`, `exposure_start`, `exposure_end`, `end` (int64 [N], µs), `x`, `y`, `width`, `height` (int16 [N]),
  and `pixels`, uint16, frame after frame, row by row
- `/inertial`: `t` (int64 [N], µs), `acceleration` (g) and `rotation` (degrees/s), float32 [N, 3], `temperature` (°C),
  float32 [N]
- `/frame_times`: int64 [N], µs, the times of the video frames that the events were emulated from
- attributes of `/`: `camera`, `serial`, `started` (wall-clock time at µs 0, ISO 8601), `note`, `temperature` (°C), and
  as JSON `biases`, `settings`, `emulator` and `imperfections`

Times are in the clock of the events; `/t_offset` isn't added to them. Each of these exists only if there are data.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from typing import Any

import numpy as np

from nvsdata.common.errors import FormatError
from nvsdata.data.events import Events
from nvsdata.data.samples import Frame, Inertial, Piece
from nvsdata.formats.hdf5.chunks import Chunks, values_of
from nvsdata.formats.hdf5.file import found_in

TIMES = ("start", "exposure_start", "exposure_end", "end")
PLACES = ("x", "y", "width", "height")
TEXTS = ("camera", "serial", "started", "note")
TABLES = ("biases", "settings", "emulator", "imperfections")
FRAME_TIMES = "frame_times"
CHUNK, CHUNK_PIXELS = 1 << 12, 1 << 16  # rows, and pixels, per chunk
GATHERED = 64  # number of frames, or of pieces with inertial samples, that are written together


class SampleWriter:
    """Writer of frames, inertial samples and metadata to an HDF5 file, while the pieces with them are iterated over.

    `finish` writes the rest. `check` is called for each piece, and raises errors of the disk.
    """

    def __init__(self, file: Any, check: Callable[[], None]) -> None:
        self._file = file
        self._check = check
        self._about: dict[str, Any] = {}
        self._samples: list[Inertial] = []
        self._frames: list[Frame] = []

    def passing(self, pieces: Iterable[Events]) -> Iterator[Events]:
        """Yield the same pieces, and write their frames and inertial samples."""
        for piece in pieces:
            if isinstance(piece, Piece):
                self._about.update(piece.about)
                if piece.inertial.t.size:
                    self._samples.append(piece.inertial)
                for frame in piece.frames:
                    self._frames.append(frame)
                    self._write(GATHERED)
                self._write(GATHERED)
                self._check()
            yield piece

    def finish(self) -> None:
        """Write the remaining samples, and the metadata."""
        self._write(1)
        for name, value in self._about.items():
            if name == "temperature":
                self._file.attrs[name] = float(value)
            elif name == FRAME_TIMES:
                self._file.create_dataset(name, data=np.asarray(value, np.int64))
            else:
                # a string of fixed length, like all strings in these files
                text = value if isinstance(value, str) else json.dumps(value)
                self._file.attrs[name] = np.bytes_(text.encode())

    def _write(self, least: int) -> None:
        """Write the collected frames if there are at least `least`, and likewise the collected inertial samples."""
        if len(self._samples) >= least:
            for name, values in Inertial.joined(self._samples)._asdict().items():
                self._append(f"inertial/{name}", values, CHUNK)
            self._samples.clear()
        if len(self._frames) >= least:
            times = [[getattr(frame, name) for frame in self._frames] for name in TIMES]
            places = zip(*((f.x, f.y, *f.pixels.shape[::-1]) for f in self._frames), strict=True)
            for name, column in zip(TIMES, times, strict=True):
                self._append(f"frames/{name}", np.array(column, np.int64), CHUNK)
            for name, place in zip(PLACES, places, strict=True):
                self._append(f"frames/{name}", np.array(place, np.int16), CHUNK)
            pixels = np.concatenate([frame.pixels.ravel() for frame in self._frames])
            self._append("frames/pixels", pixels.astype(np.uint16, copy=False), CHUNK_PIXELS)
            self._frames.clear()

    def _append(self, name: str, values: np.ndarray, chunk: int) -> None:
        tail = values.shape[1:]
        if name not in self._file:
            layout: dict[str, Any] = {"maxshape": (None, *tail), "chunks": (chunk, *tail)}
            self._file.create_dataset(name, (0, *tail), values.dtype, **layout)
        dataset = self._file[name]
        count = len(dataset)
        dataset.resize(count + len(values), 0)
        dataset[count:] = values


def inertial_in(path: str, file: Any, dataset: Callable[[str], Any], start: int | None, stop: int | None) -> Inertial:
    """Return the inertial samples of an open file with start <= t < stop (µs).

    `dataset` returns a checked dataset by name.
    """
    if found_in(path, file.id, "inertial") is None:
        return Inertial.empty()
    found = Inertial(*(values_of(path, dataset(f"inertial/{name}")) for name in Inertial._fields))
    count = found.t.size
    shapes = [column.shape for column in found]
    if shapes != [(count,), (count, 3), (count, 3), (count,)] or found.t.dtype.kind not in "iu":
        raise FormatError(path, f"/inertial has columns of {shapes}")
    kinds = (np.int64, np.float32, np.float32, np.float32)
    return Inertial(*(c.astype(k, copy=False) for c, k in zip(found, kinds, strict=True))).window(start, stop)


def frames_in(
    path: str, file: Any, dataset: Callable[[str], Any], start: int | None, stop: int | None
) -> Iterator[Frame]:
    """Yield the frames of an open file whose exposure begins at start <= t < stop (µs), read one by one.

    `dataset` returns a checked dataset by name.
    """
    if found_in(path, file.id, "frames") is None:
        return
    columns = {name: values_of(path, dataset(f"frames/{name}")) for name in (*TIMES, *PLACES)}
    pixels = dataset("frames/pixels")
    shapes = {column.shape for column in columns.values()}
    if len(shapes) != 1 or any(column.ndim != 1 or column.dtype.kind not in "iu" for column in columns.values()):
        raise FormatError(path, f"/frames has columns of {sorted(shapes)}")
    sizes = columns["width"].astype(np.int64) * columns["height"]
    ends = np.cumsum(sizes)
    least = min((int(columns[name].min(initial=1)) for name in ("width", "height")), default=1)
    if least < 1 or pixels.ndim != 1 or pixels.dtype != np.uint16 or (ends[-1] if ends.size else 0) != pixels.size:
        raise FormatError(path, f"/frames/pixels is {pixels}, not uint16 of {int(sizes.sum())} pixels")
    begins = columns["exposure_start"].astype(np.int64)
    wanted = np.ones(begins.size, bool) if start is None else begins >= start
    wanted &= True if stop is None else begins < stop
    stored = Chunks(path, pixels)
    for n in np.flatnonzero(wanted):
        row = {name: int(column[n]) for name, column in columns.items()}
        image = stored.read(int(ends[n] - sizes[n]), int(ends[n])).reshape(row.pop("height"), row.pop("width"))
        yield Frame(**row, pixels=image)


def frame_times_in(path: str, file: Any, dataset: Callable[[str], Any]) -> dict[str, np.ndarray]:
    """Return {"frame_times": times in µs of the frames that an open file's events were emulated from}, or {}."""
    if found_in(path, file.id, FRAME_TIMES) is None:
        return {}
    times = values_of(path, dataset(FRAME_TIMES))
    if times.ndim != 1 or times.dtype.kind not in "iu":
        raise FormatError(path, f"/{FRAME_TIMES} is {times.dtype} {list(times.shape)}, not times")
    return {FRAME_TIMES: times.astype(np.int64)}


def about_in(texts: Callable[[str], str], number: Callable[[str], Any]) -> dict[str, Any]:
    """Return the metadata of a file; `texts` and `number` return an attribute by name, if it exists."""
    about: dict[str, Any] = {name: text for name in TEXTS if (text := texts(name))}
    for name in TABLES:
        with suppress(ValueError, RecursionError):
            if isinstance(table := json.loads(texts(name) or "0"), dict):
                about[name] = table
    with suppress(TypeError, ValueError):
        about["temperature"] = float(number("temperature"))
    return about
