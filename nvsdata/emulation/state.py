"""State of an emulation over frames of one size: the part that all emulators share."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import deque
from dataclasses import dataclass
from functools import cache

import numpy as np

from nvsdata.common.prefetch import DEPTH
from nvsdata.data.events import MAX_COORDINATE, Columns, Events
from nvsdata.emulation.imperfections import Imperfections, ImperfectSensor
from nvsdata.kernels.emulate.frames import read_keys
from nvsdata.video.video_frame import FULL, VideoFrame, rgb_luminance, stretch_levels

LONGEST = 2**31  # µs; times in keys are below it
KEPT = 2 * DEPTH + 3  # frames whose keys are kept until they are read
# methods whose timestamps are stored in the keys; linear timestamps follow from the raster order
KEYED = ("interpolated", "random")


@dataclass
class FrameSpikes:
    """Spikes between two frames, packed as keys.

    Args:
        keys: uint64 [n] in raster order; `kernels.emulate.frames` describes their bits.
        before: Time of the earlier frame (µs).
        now: Time of the later frame (µs).
        timestamps: Method by which spikes get their times; see `PIX2NVS`.
        sensor_size: (width, height) in pixels.
        whole: False if upsampling made the later frame.
        light: Brightness of pixels at `now`, 0 to 1, [H, W]; None if noise doesn't depend on it.
    """

    keys: np.ndarray
    before: int
    now: int
    timestamps: str
    sensor_size: tuple[int, int]
    whole: bool = True
    light: np.ndarray | None = None

    def events(self) -> Events:
        """Return the spikes as events, sorted by time."""
        count, keys = self.keys.size, self.keys
        if count == 0:
            return Events.empty(self.sensor_size, self.before, self.now)
        columns = Columns.empty(count)
        bits = int(self.now - self.before).bit_length() if self.timestamps in KEYED else 0
        read_keys(keys, bits, self.before, *columns)
        if self.timestamps == "fixed":
            columns.t[:] = self.now
        elif self.timestamps == "linear":
            columns.t[:] = self.before + np.arange(1, count + 1) * (self.now - self.before) // count
        return Events.trusted(columns, self.sensor_size, self.before, self.now)


@cache
def _keep_freed_memory() -> None:
    """Make glibc keep freed memory.

    Otherwise it returns each frame's arrays to the system, and fresh pages cost more than the work on them. Freeing one
    large array raises the size from which glibc returns memory.
    """
    np.empty(31 << 20, np.uint8)


class EmulatorState(ABC):
    """State of an emulation. It keeps the latest frame without copying it, so the caller must not change that frame.

    Args:
        settings: The emulator, with the settings of its imperfections.
        first: First frame, whose size and type all others must have.
        timestamps: Method by which spikes get their times; see `PIX2NVS`.

    Raises:
        ValueError: The frame is larger than events can address.
    """

    def __init__(self, settings: ImperfectSensor, first: VideoFrame, timestamps: str = "interpolated") -> None:
        _keep_freed_memory()
        height, width = first.pixels.shape[:2]
        if max(height, width) > MAX_COORDINATE + 1:
            raise ValueError(f"frames of {width}x{height} are larger than events can address")
        self.sensor_size, self.timestamps = (width, height), timestamps
        self.imperfections = Imperfections.of(settings, self.sensor_size)
        self._last = first
        self._keys = deque(np.empty(height * width + 64 * width, np.uint64) for _ in range(KEPT))

    def none(self, now: int) -> FrameSpikes:
        """Return a `FrameSpikes` without spikes, for a frame at `now` µs."""
        return FrameSpikes(self._keys[0][:0], now, now, self.timestamps, self.sensor_size)

    def step(self, frame: VideoFrame) -> FrameSpikes:
        """Return the spikes between the previous frame and this one; read them before `KEPT` more steps overwrite them.

        Raises:
            ValueError: Size or type of the frame differ from the first one's, or times don't rise.
        """
        last, self._last = self._last, frame
        before, now = last.time, frame.time
        a, b = frame.pixels, last.pixels
        if a.shape != b.shape or a.dtype != b.dtype or frame.levels != last.levels:
            raise ValueError(f"the frame at {now} µs is {_kind(frame)}, earlier ones were {_kind(last)}")
        if not 0 < now - before < LONGEST:
            raise ValueError(
                f"the frame at {now} µs follows the one at {before} µs: times must rise, by less than 35 min"
            )
        self._keys.rotate()
        keys = self._spikes(frame, last)
        return FrameSpikes(keys, before, now, self.timestamps, self.sensor_size, frame.whole, self._light())

    def events(self, spikes: FrameSpikes) -> Events:
        """Return the events of spikes, with the sensor's imperfections. Call it once per frame, in order."""
        found = spikes.events()
        if self.imperfections is None or spikes.now == spikes.before:
            return found
        return self.imperfections.apply(found, spikes.before, spikes.now, spikes.light)

    def _light(self) -> np.ndarray | None:
        """Return the `light` of `FrameSpikes`."""
        return None

    @abstractmethod
    def _spikes(self, frame: VideoFrame, last: VideoFrame) -> np.ndarray:
        """Return the keys of the spikes between the frames `last` and `frame`; they are stored in `_keys[0]`."""


def frame_bytes(frame: VideoFrame) -> np.ndarray:
    """Return the frame's bytes, [H, bytes per row]."""
    return frame.pixels.view(np.uint8).reshape(frame.pixels.shape[0], -1)


def first_weight(frame: VideoFrame) -> int:
    """Return the weight of a pixel's first byte in the luminance, in thousandths."""
    return 299 if frame.red_first else 114


def _kind(frame: VideoFrame) -> str:
    """Describe the size and type of a frame, which must be the same for all frames of a video."""
    height, width, *colors = frame.pixels.shape
    levels = "" if frame.levels == FULL else " from {} to {}".format(*frame.levels)
    return f"{width}x{height} {'color' if colors else 'gray'} {frame.pixels.dtype}{levels}"


def brightness(frame: VideoFrame, hue: bool = False) -> np.ndarray:
    """Return luminance q or hue h (thesis, section 3.2.1), float64 [H, W]; black has hue 0."""
    values: np.ndarray = frame.pixels.astype(np.float64)
    if values.ndim == 2:
        values = values if frame.levels == FULL else stretch_levels(values, frame.levels)
        return np.where(values > 0, 0.5, 0.0) if hue else values
    r, g, b = np.moveaxis(values if frame.red_first else values[..., ::-1], -1, 0)
    if hue:
        return np.asarray(np.divide(b, r + g, out=b.copy(), where=r + g > 0))
    return rgb_luminance(r, g, b)
