"""State of a DVS emulation: its arrays, and the step from one frame to the next."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any

import numpy as np

from nvsdata.emulation.settings import DVSSettings
from nvsdata.emulation.state import EmulatorState, brightness, first_weight, frame_bytes
from nvsdata.kernels.emulate.crossings import NEVER, Array, Sensor, advance, advance_receptors, receptor_rates
from nvsdata.kernels.emulate.frames import TILE, logarithm
from nvsdata.kernels.emulate.pix2nvs import TABLE_SIZE
from nvsdata.video.video_frame import VideoFrame, stretch_levels

THOUSAND = 1000  # dark is rounded to thousandths of a gray level, as luminance is


class DVSState(EmulatorState):
    """State of an emulation by `DVS`; `EmulatorState` describes the parameters."""

    def __init__(self, settings: DVSSettings, first: VideoFrame) -> None:
        super().__init__(settings, first)
        self._noisy = settings.noise_rate > 0
        self._start = first.time
        shape = first.pixels.shape[:2]
        number = _precision(settings)
        self._dark = round(settings.dark * THOUSAND) / THOUSAND
        self._sensor = _sensor(settings, shape, number, _table(self._dark, first, number))
        level = _levels(first, self._dark, number)
        memory = level - _beginnings(settings, shape, self._sensor.each).astype(number)
        slow = level if settings.cutoff else np.empty((0, 0), number)
        tiles = (-(-shape[0] // TILE[0]), -(-shape[1] // TILE[1]))
        wake = np.full(tiles, 0 if settings.leak else NEVER, np.int64)
        dirty, since = np.zeros(tiles, np.bool_), np.zeros(tiles, np.int64)
        self._array = Array(level, memory, slow.copy(), receptor_rates(slow, self._sensor), dirty, wake, since)

    def _spikes(self, frame: VideoFrame, last: VideoFrame) -> np.ndarray:
        before, now = last.time - self._start, frame.time - self._start
        number = self._array.level.dtype.type
        given = np.empty((0, 0), number) if frame.pixels.dtype == np.uint8 else _levels(frame, self._dark, number)
        frames = frame_bytes(frame), frame_bytes(last), first_weight(frame), given
        process = advance_receptors if self._sensor.speed else advance
        self._keys[0], count = process(*frames, self._sensor, self._array, before, now, self._keys[0])
        return self._keys[0][:count]

    def _light(self) -> np.ndarray | None:
        return (np.exp(self._array.level) - self._dark) / 255 if self._noisy else None


def _precision(settings: DVSSettings) -> Any:
    """Return float32 where its rounding hardly ever shifts an event by more than 1 µs at 25 frames/s, else float64."""
    plain = not settings.leak and not settings.cutoff and settings.dark >= 0.1
    return np.float32 if plain and min(settings.on, settings.off) >= 0.05 else np.float64


def _sensor(settings: DVSSettings, shape: tuple[int, int], number: Any, table: np.ndarray) -> Sensor:
    thresholds = np.array((settings.off, settings.on), number)
    each = np.empty((2, 0, 0), number)
    if settings.mismatch:
        spread = np.random.default_rng((settings.seed, 2)).normal(1, settings.mismatch, (2, *shape))
        each = (np.maximum(spread, 0.1) * thresholds[:, None, None]).astype(number)
    # converts rates per second to rates per µs
    leak, speed = settings.leak * settings.on / 1e6, 2 * math.pi * settings.cutoff / 1e6
    return Sensor(table, round(settings.dark * THOUSAND), thresholds, each, leak, speed)


def _beginnings(settings: DVSSettings, shape: tuple[int, int], each: np.ndarray) -> np.ndarray:
    """Return L - M of `DVS` at the first frame, [H, W]: random from 0 to the ON threshold with a leak, else 0."""
    if not settings.leak:
        return np.zeros(shape)
    on = each[1] if each.size else settings.on
    return np.asarray(np.random.default_rng((settings.seed, 4)).random(shape) * on)


def _levels(frame: VideoFrame, dark: float, number: Any) -> np.ndarray:
    """Return ln(q + dark) of a frame, [H, W]; for 8-bit colors in float32, the kernel's logarithm."""
    q = brightness(frame)
    if number != np.float32 or frame.pixels.ndim == 2 or frame.pixels.dtype != np.uint8:
        return np.asarray(np.log(q + dark).astype(number))
    found = np.empty(q.shape, np.float32)
    logarithm(np.rint(THOUSAND * (q + dark)).astype(np.int32).ravel(), 0, 1, found.reshape(-1))
    return found


def _table(dark: float, first: VideoFrame, number: Any) -> np.ndarray:
    """Return ln(q + dark) of each gray byte, or of each luminance in thousandths; empty for colors in float32."""
    if first.pixels.ndim == 2:
        return np.log(stretch_levels(np.arange(256), first.levels) + dark).astype(number)
    return np.empty(0, np.float32) if number is np.float32 else _colors(dark)


@lru_cache(8)
def _colors(dark: float) -> np.ndarray:
    """Return the table for colors; it is cached, because all videos of a folder use the same."""
    return np.log(np.arange(TABLE_SIZE) / THOUSAND + dark)
