"""One run of an emulator over frames of one size: what every emulator's runs have in common."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import deque
from dataclasses import dataclass
from functools import cache

import numpy as np

from nvsdata.common.prefetch import DEPTH
from nvsdata.data.events import MAX_COORDINATE, Columns, Events
from nvsdata.kernels.emulate.spikes import read
from nvsdata.video.decoder import FULL, luminance, stretched
from nvsdata.video.frames import Frame

LONGEST = 2**31  # µs between frames that keys can hold
KEPT = 2 * DEPTH + 3  # frames whose keys may be waiting to be read
KEYED = ("interpolated", "random")  # times that keys hold; linear ones follow from the raster order


@dataclass
class Spikes:
    """What fired between two frames.

    - `keys`: see `kernels.emulate.spikes`, in raster order; uint64 [n]
    - `before`, `now`: times of the two frames (µs)
    - `timestamps`: how times lie between them; see `PIX2NVS`
    - `sensor_size`: (width, height)
    - `whole`: whether the later one is the video's; see `Frame` (default True)
    - `light`: brightness of pixels at `now`, 0 to 1, where noise depends on it (default None)
    """

    keys: np.ndarray
    before: int
    now: int
    timestamps: str
    sensor_size: tuple[int, int]
    whole: bool = True
    light: np.ndarray | None = None

    def events(self) -> Events:
        """The spikes as events, sorted by time."""
        count, keys = self.keys.size, self.keys
        if count == 0:
            return Events.empty(self.sensor_size, self.before, self.now)
        columns = Columns.empty(count)
        bits = int(self.now - self.before).bit_length() if self.timestamps in KEYED else 0
        read(keys, bits, self.before, *columns)
        if self.timestamps == "fixed":
            columns.t[:] = self.now
        elif self.timestamps == "linear":
            columns.t[:] = self.before + np.arange(1, count + 1) * (self.now - self.before) // count
        return Events.trusted(columns, self.sensor_size, self.before, self.now)


@cache
def _keep_freed_memory() -> None:
    """Have glibc keep freed memory: it would give back each frame's arrays, and fresh pages cost more than the work on
    them. Freeing one large array raises the size from which glibc gives memory back to the system.
    """
    np.empty(31 << 20, np.uint8)


class Run(ABC):
    """State of an emulation. The last frame is kept, not copied: the caller must not change it.

    - `first`: the first frame, which gives the size and type of all
    - `timestamps`: how times lie between frames; see `PIX2NVS` (default "interpolated")

    ValueError if the frame is larger than events can address.
    """

    def __init__(self, first: Frame, timestamps: str = "interpolated") -> None:
        _keep_freed_memory()
        height, width = first.pixels.shape[:2]
        if max(height, width) > MAX_COORDINATE + 1:
            raise ValueError(f"frames of {width}x{height} are larger than events can address")
        self.sensor_size, self.timestamps = (width, height), timestamps
        self._last = first
        self._keys = deque(np.empty(height * width + 64 * width, np.uint64) for _ in range(KEPT))

    def none(self, now: int) -> Spikes:
        """The spikes of a frame at `now` µs that gives no events."""
        return Spikes(self._keys[0][:0], now, now, self.timestamps, self.sensor_size)

    def step(self, frame: Frame) -> Spikes:
        """Spikes between the last frame and this one; read them before `KEPT` more steps.

        ValueError for a frame whose size or type differs from the first one's, and for times that don't rise.
        """
        last, self._last = self._last, frame
        before, now = last.time, frame.time
        if not _alike(frame, last):
            raise ValueError(f"the frame at {now} µs is {_kind(frame)}, earlier ones were {_kind(last)}")
        if not 0 < now - before < LONGEST:
            raise ValueError(f"the frame at {now} µs follows the one at {before} µs: times must rise, by under 35 min")
        self._keys.rotate()
        keys = self._spikes(frame, last)
        return Spikes(keys, before, now, self.timestamps, self.sensor_size, frame.whole, self._light())

    def _light(self) -> np.ndarray | None:
        """See `Spikes`."""
        return None

    @abstractmethod
    def _spikes(self, frame: Frame, last: Frame) -> np.ndarray:
        """The keys of what fires after the last frame, in `_keys[0]`."""


def bytes_of(frame: Frame) -> np.ndarray:
    """The frame's bytes, [H, bytes of a row]."""
    return frame.pixels.view(np.uint8).reshape(frame.pixels.shape[0], -1)


def first_weight(frame: Frame) -> int:
    """Weight of a pixel's first byte in the luminance, in thousandths."""
    return 299 if frame.red_first else 114


def _alike(frame: Frame, other: Frame) -> bool:
    """Whether two frames can belong to one video."""
    a, b = frame.pixels, other.pixels
    return a.shape == b.shape and a.dtype == b.dtype and frame.levels == other.levels


def _kind(frame: Frame) -> str:
    """What all frames of a video must share, in words."""
    height, width, *colors = frame.pixels.shape
    levels = "" if frame.levels == FULL else " from {} to {}".format(*frame.levels)
    return f"{width}x{height} {'color' if colors else 'gray'} {frame.pixels.dtype}{levels}"


def brightness(frame: Frame, hue: bool = False) -> np.ndarray:
    """Luminance q or hue h (3.2.1), float64 [H, W]; black has hue 0."""
    values: np.ndarray = frame.pixels.astype(np.float64)
    if values.ndim == 2:
        values = values if frame.levels == FULL else stretched(values, frame.levels)
        return np.where(values > 0, 0.5, 0.0) if hue else values
    r, g, b = np.moveaxis(values if frame.red_first else values[..., ::-1], -1, 0)
    if hue:
        return np.asarray(np.divide(b, r + g, out=b.copy(), where=r + g > 0))
    return luminance(r, g, b)
