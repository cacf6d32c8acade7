"""One run of `DVS` over frames of one size: the arrays that it keeps, and the step from frame to frame."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any

import numpy as np

from nvsdata.emulation.run import Run, brightness, bytes_of, first_weight
from nvsdata.emulation.settings import SensorSettings
from nvsdata.kernels.crossings import NEVER, Array, Sensor, advance, rate
from nvsdata.kernels.emulate import TABLE_SIZE
from nvsdata.kernels.logarithm import logarithm
from nvsdata.kernels.tiles import TILE
from nvsdata.video.decoder import stretched
from nvsdata.video.frames import Frame

STEP = 0.5  # of a white pixel's time constant
CALMER = 24  # part of the time since a frame by which steps grow: the slowest receptors are 14 times as slow
THOUSAND = 1000  # dark is rounded to thousandths of a gray level, as luminance is


class PixelArray(Run):
    """State of an emulation by `DVS`, of which `settings` are; see `Run` for the rest."""

    def __init__(self, settings: SensorSettings, first: Frame) -> None:
        super().__init__(first)
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
        self._array = Array(level, memory, slow.copy(), rate(slow, self._sensor), dirty, wake, since)

    def _spikes(self, frame: Frame, last: Frame) -> np.ndarray:
        before, now = last.time - self._start, frame.time - self._start
        if self._sensor.speed:
            return self._slowly(frame, last, before, now)
        number = self._array.level.dtype.type
        given = np.empty((0, 0), number) if frame.pixels.dtype == np.uint8 else _levels(frame, self._dark, number)
        return self._advanced(frame, last, given, before, now)

    def _slowly(self, frame: Frame, last: Frame, before: int, now: int) -> np.ndarray:
        """The keys of small steps along the line of light, in which where photoreceptors are is nearly a line, too."""
        still = np.array_equal(frame.pixels, last.pixels)
        if still and not (self._array.wake <= now).any():
            return self._keys[0][:0]
        start = self._array.level.copy()
        # a still frame gives no level to any tile
        end = start if still else _levels(frame, self._dark, np.float64)
        found, then = [], before
        for moment in _moments(before, now, self._sensor.speed):
            share = (moment - before) / (now - before)
            level = end if still or moment == now else start + share * (end - start)
            keys = self._advanced(frame, last, level, then, moment)
            found.append(keys + np.uint64((then - before) << 32))
            then = moment
        keys = np.concatenate(found)
        if keys.size > self._keys[0].size:
            self._keys[0] = np.empty(2 * keys.size, np.uint64)
        self._keys[0][: keys.size] = keys
        return self._keys[0][: keys.size]

    def _advanced(self, frame: Frame, last: Frame, given: np.ndarray, before: int, now: int) -> np.ndarray:
        gap = now - before
        span = np.array([gap], np.float64 if gap > 1 << 21 else self._array.level.dtype)
        frames = bytes_of(frame), bytes_of(last), first_weight(frame), given
        self._keys[0], count = advance(*frames, self._sensor, self._array, before, now, span, self._keys[0])
        return self._keys[0][:count]

    def _light(self) -> np.ndarray | None:
        return (np.exp(self._array.level) - self._dark) / 255 if self._noisy else None


def _moments(before: int, now: int, speed: float) -> list[int]:
    """Ends of steps of half a white pixel's time constant, which grow once darker ones alone are on their way."""
    found, moment = [], float(before)
    while moment < now:
        moment = min(moment + max(STEP / speed, (moment - before) / CALMER, 1.0), now)
        found.append(round(moment))
    return list(dict.fromkeys(found))


def _precision(settings: SensorSettings) -> Any:
    """float32 where its rounding hardly ever shifts an event by more than 1 µs at 25 frames/s."""
    plain = not settings.leak and not settings.cutoff and settings.dark >= 0.1
    return np.float32 if plain and min(settings.on, settings.off) >= 0.05 else np.float64


def _sensor(settings: SensorSettings, shape: tuple[int, int], number: Any, table: np.ndarray) -> Sensor:
    thresholds = np.array((settings.off, settings.on), number)
    each = np.empty((2, 0, 0), number)
    if settings.mismatch:
        spread = np.random.default_rng((settings.seed, 2)).normal(1, settings.mismatch, (2, *shape))
        each = (np.maximum(spread, 0.1) * thresholds[:, None, None]).astype(number)
    # s to µs
    leak, speed = settings.leak * settings.on / 1e6, 2 * math.pi * settings.cutoff / 1e6
    return Sensor(table, round(settings.dark * THOUSAND), thresholds, each, leak, speed)


def _beginnings(settings: SensorSettings, shape: tuple[int, int], each: np.ndarray) -> np.ndarray:
    """How far above their memories pixels begin, [H, W]: anywhere below `on` if that rises by itself, else nowhere."""
    if not settings.leak:
        return np.zeros(shape)
    on = each[1] if each.size else settings.on
    return np.asarray(np.random.default_rng((settings.seed, 4)).random(shape) * on)


def _levels(frame: Frame, dark: float, number: Any) -> np.ndarray:
    """ln(q + dark) of a frame, [H, W]; in float32, that of colors takes the same steps as in the kernels."""
    q = brightness(frame)
    if number != np.float32 or frame.pixels.ndim == 2 or frame.pixels.dtype != np.uint8:
        return np.asarray(np.log(q + dark).astype(number))
    found, scratch = np.empty(q.shape, np.float32), np.empty((2, q.size), np.uint32)
    thousandths = np.rint(THOUSAND * (q + dark)).astype(np.int32).ravel()
    logarithm(thousandths, np.float32(0), np.float32(1), scratch, found.reshape(-1))
    return found


def _table(dark: float, first: Frame, number: Any) -> np.ndarray:
    """Level of each gray byte, or of each luminance in thousandths; empty for colors in float32, which need none."""
    if first.pixels.ndim == 2:
        return np.log(stretched(np.arange(256), first.levels) + dark).astype(number)
    return np.empty(0, np.float32) if number is np.float32 else _colors(dark)


@lru_cache(8)
def _colors(dark: float) -> np.ndarray:
    """The table for colors; cached, because a folder has many videos."""
    return np.log(np.arange(TABLE_SIZE) / THOUSAND + dark)
