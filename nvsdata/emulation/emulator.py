"""One run of PIX2NVS over frames of one size: the arrays that it keeps, and the step from frame to frame."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from functools import cache, lru_cache
from typing import Any

import numpy as np

from nvsdata.common.prefetch import DEPTH
from nvsdata.data.events import MAX_COORDINATE, Columns, Events
from nvsdata.emulation.settings import Settings
from nvsdata.kernels import emulate as kernels
from nvsdata.kernels.logarithm import logarithm
from nvsdata.kernels.spikes import AT_ONCE, INTERPOLATED, RANDOM, read
from nvsdata.kernels.tiles import AVERAGE, CO_LOCATED, MINIMUM, TILE, Pixels, Rule, Tiles, look
from nvsdata.video.decoder import FULL, luminance, stretched
from nvsdata.video.frames import Frame

METHODS = {"co-located": CO_LOCATED, "average": AVERAGE, "minimum": MINIMUM}
# linear times need no key: they follow from the raster order
TIMINGS = {"interpolated": INTERPOLATED, "random": RANDOM}
LONGEST = 2**31  # µs between frames that keys can hold
BAND = 4 * TILE[0]  # rows that are processed at a time where no pixel depends on its neighbors
KEPT = 2 * DEPTH + 3  # frames whose keys may be waiting to be read


@dataclass
class Spikes:
    """What fired between two frames.

    - `keys`: as `kernels.spikes.fire` makes them, in raster order; uint64 [n]
    - `before`, `now`: times of the two frames (µs)
    - `timestamps`: how times lie between them; see `PIX2NVS`
    - `sensor_size`: (width, height)
    """

    keys: np.ndarray
    before: int
    now: int
    timestamps: str
    sensor_size: tuple[int, int]

    def events(self) -> Events:
        """The spikes as events, sorted by time."""
        count, keys = self.keys.size, self.keys
        if count == 0:
            return Events.empty(self.sensor_size, self.before, self.now)
        columns = Columns.empty(count)
        bits = int(self.now - self.before).bit_length() if self.timestamps in TIMINGS else 0
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


class Emulator:
    """State of an emulation. The last frame is kept, not copied: the caller must not change it.

    - `settings`: those of PIX2NVS
    - `first`: the first frame, which gives the size and type of all

    ValueError if the frame is smaller than `inhibition`, or larger than events can address.
    """

    def __init__(self, settings: Settings, first: Frame) -> None:
        _keep_freed_memory()
        height, width = first.pixels.shape[:2]
        if settings.inhibition > min(height, width):
            raise ValueError(f"inhibition={settings.inhibition} is larger than the frame of {width}x{height}")
        if max(height, width) > MAX_COORDINATE + 1:
            raise ValueError(f"frames of {width}x{height} are larger than events can address")
        self.settings, self.sensor_size = settings, (width, height)
        number = _precision(settings)
        tiles = (-(-height // TILE[0]), -(-width // TILE[1]))
        dirty, active, still = (np.full(tiles, value) for value in (True, True, False))
        affected = dirty if settings.mode == "LI" else dirty.copy()
        self._tiles = Tiles(dirty, affected, active, still, np.zeros(tiles, np.int64))
        self._rule = _rule(settings, (height, width), number, _table(settings, first, number))
        self._number = 0
        self._last = first
        plane = np.empty((height, width), number)
        level = plane if settings.mode == "LI" else np.empty_like(plane)
        # whole tiles and whole blocks
        whole = math.lcm(TILE[0], settings.inhibition)
        band = max(BAND // whole, 1) * whole if settings.difference == "co-located" else height
        difference = np.zeros((min(height, band), width), number)
        self._pixels = Pixels(plane, level, np.empty_like(plane), difference)
        self._see(first)
        self._pixels.reference[:] = level
        self._keys = deque(np.empty(height * width + 64 * width, np.uint64) for _ in range(KEPT))

    def none(self, now: int) -> Spikes:
        """The spikes of a frame at `now` µs that gives no events."""
        return Spikes(self._keys[0][:0], now, now, self.settings.timestamps, self.sensor_size)

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
        self._number += 1
        return Spikes(self._spikes(frame, last), before, now, self.settings.timestamps, self.sensor_size)

    def _spikes(self, frame: Frame, last: Frame) -> np.ndarray:
        """The keys of what fires after the last frame."""
        rule, tiles, pixels, span = self._rule, self._tiles, self._pixels, frame.time - last.time
        spans = np.array([span], np.float64 if span > 1 << 21 else pixels.plane.dtype)
        seed = np.uint64(0)
        if rule.timing == RANDOM:
            # the frame's number sets the seed, so that skipped frames change nothing
            seed = np.random.SeedSequence((self.settings.seed, self._number)).generate_state(1, np.uint64)[0]
        self._keys.rotate()
        new, old = _bytes(frame), _bytes(last)
        if rule.contrast or not _of_bytes(frame, self.settings):
            if not look(new, old, rule, tiles, pixels):
                return self._keys[0][:0]
            self._see(frame)
            new = new[:0]
        arguments = new, old, _first_weight(frame), rule, tiles, pixels, spans, seed, self._keys[0]
        self._keys[0], count = kernels.step(*arguments)
        return self._keys[0][:count]

    def _see(self, frame: Frame) -> None:
        """Bring `plane` and `level` up to date where the frame changed."""
        settings, rule, tiles, pixels = self.settings, self._rule, self._tiles, self._pixels
        if _of_bytes(frame, settings):
            kernels.luminance(_bytes(frame), _first_weight(frame), rule, tiles.dirty, pixels.plane)
        elif tiles.dirty.any():
            pixels.plane[:] = perceived(settings, brightness(frame, settings.hue), pixels.plane.dtype)
        if rule.contrast:
            both = settings.mode == "LICE"
            kernels.contrast(pixels.plane, tiles.affected, both, rule.t_log, rule.slope, pixels.level)


def _rule(settings: Settings, shape: tuple[int, int], number: Any, table: np.ndarray) -> Rule:
    """The settings as kernels take them."""
    threshold, sensitivity = number(settings.threshold), _sensitivity(settings, shape).astype(number)
    return Rule(
        contrast=settings.mode != "LI",
        table=table,
        t_log=number(settings.t_log),
        slope=number(_slope(settings)),
        method=METHODS[settings.difference],
        sensitivity=sensitivity,
        side=settings.inhibition,
        threshold=threshold,
        most=settings.max_events,
        timing=TIMINGS.get(settings.timestamps, AT_ONCE),
        alpha=number(settings.alpha if settings.exp else 1),
        everywhere=settings.new,
        # a little less, so that rounding never lets a pixel of a still tile reach its threshold
        calm=threshold / max(number(1), sensitivity.max(initial=0)) * (1 - 4 * np.finfo(number).eps),
    )


def _first_weight(frame: Frame) -> int:
    """Weight of a pixel's first byte in the luminance, in thousandths."""
    return 299 if frame.red_first else 114


def _of_bytes(frame: Frame, settings: Settings) -> bool:
    return frame.pixels.dtype == np.uint8 and not settings.hue


def _bytes(frame: Frame) -> np.ndarray:
    """The frame's bytes, [H, bytes of a row]."""
    return frame.pixels.view(np.uint8).reshape(frame.pixels.shape[0], -1)


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


def tone(settings: Settings, q: np.ndarray) -> np.ndarray:
    """What brightness q (0 to 255) is seen as: (3.1) for mode LI, else the perceptual luminance (3.2) starts from."""
    if settings.mode != "LI":
        return 100 * np.sqrt((q / 255) ** settings.gamma)
    with np.errstate(divide="ignore"):
        return np.where(q > settings.t_log, np.log(q), q * _slope(settings))


def perceived(settings: Settings, q: np.ndarray, number: Any) -> np.ndarray:
    """`tone` in the type that emulation calculates in; in float32, logarithms take the same steps as in the kernels."""
    if number != np.float32:
        return tone(settings, q)
    found, scratch = np.empty(q.shape, np.float32), np.empty((2, q.size), np.uint32)
    thousandths = (1000 * q).astype(np.float32).ravel()
    logarithm(thousandths, np.float32(settings.t_log), np.float32(_slope(settings)), scratch, found.reshape(-1))
    return found


def _table(settings: Settings, first: Frame, number: Any) -> np.ndarray:
    """What each gray value, or each luminance in thousandths, is seen as; see `kernels.emulate.luminance`."""
    if first.pixels.ndim == 2:
        return perceived(settings, stretched(np.arange(256), first.levels), number)
    # logarithms in float32 have no table: computing them is faster than looking them up
    return np.empty(0, np.float32) if number is np.float32 else _tone_table(settings)


@lru_cache(8)
def _tone_table(settings: Settings) -> np.ndarray:
    """`tone` of luminance in thousandths; cached, because a folder has many videos."""
    return tone(settings, np.arange(kernels.TABLE_SIZE) / 1000)


def _slope(settings: Settings) -> float:
    """Slope of the linear part of (3.1)."""
    return float(np.log(settings.t_log) / settings.t_log) if settings.continuous and settings.t_log else 1.0


def _precision(settings: Settings) -> Any:
    """float32 where its rounding shifts no event by 1 µs at 25 frames/s: logarithms, no tiny threshold or alpha.

    A moving average in float32 stays up to 2^-22 / alpha away from its level, because smaller steps are lost.
    """
    plain = settings.mode == "LI" and settings.t_log <= 32
    follows = not settings.exp or settings.alpha >= 0.01
    return np.float32 if plain and follows and settings.threshold >= 0.05 else np.float64


def _sensitivity(settings: Settings, shape: tuple[int, int]) -> np.ndarray:
    """The nominal threshold over each pixel's own, [H, W]; empty if all are alike.

    No pixel's own threshold is below a tenth of the nominal one.
    """
    if settings.mismatch == 0:
        return np.empty((0, 0))
    spread = np.random.default_rng((settings.seed, 2)).normal(1, settings.mismatch, shape)
    return np.asarray(1 / np.maximum(spread, 0.1))
