"""One run of PIX2NVS over frames of one size: the arrays that it keeps, and the step from frame to frame."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any

import numpy as np

from nvsdata.emulation.run import KEYED, Run, brightness, bytes_of, first_weight
from nvsdata.emulation.settings import Settings
from nvsdata.kernels.emulate import pix2nvs as kernels
from nvsdata.kernels.emulate.logarithm import logarithm
from nvsdata.kernels.emulate.pix2nvs import (
    AT_ONCE,
    AVERAGE,
    CO_LOCATED,
    INTERPOLATED,
    MINIMUM,
    RANDOM,
    Pixels,
    Rule,
    Tiles,
    look,
)
from nvsdata.kernels.emulate.tiles import TILE
from nvsdata.video.decoder import stretched
from nvsdata.video.frames import Frame

METHODS = {"co-located": CO_LOCATED, "average": AVERAGE, "minimum": MINIMUM}
TIMINGS = dict(zip(KEYED, (INTERPOLATED, RANDOM), strict=True))
BAND = 4 * TILE[0]  # rows that are processed at a time where no pixel depends on its neighbors


class Emulator(Run):
    """State of an emulation by PIX2NVS, of which `settings` are; see `Run` for the rest.

    ValueError if the frame is smaller than `inhibition`, or larger than events can address.
    """

    def __init__(self, settings: Settings, first: Frame) -> None:
        super().__init__(first, settings.timestamps)
        height, width = first.pixels.shape[:2]
        if settings.inhibition > min(height, width):
            raise ValueError(f"inhibition={settings.inhibition} is larger than the frame of {width}x{height}")
        self.settings = settings
        number = _precision(settings)
        tiles = (-(-height // TILE[0]), -(-width // TILE[1]))
        dirty, active, still = (np.full(tiles, value) for value in (True, True, False))
        affected = dirty if settings.mode == "LI" else dirty.copy()
        self._tiles = Tiles(dirty, affected, active, still, np.zeros(tiles, np.int64))
        self._rule = _rule(settings, (height, width), number, _table(settings, first, number))
        self._number = 0
        plane = np.empty((height, width), number)
        level = plane if settings.mode == "LI" else np.empty_like(plane)
        # whole tiles and whole blocks
        whole = math.lcm(TILE[0], settings.inhibition)
        band = max(BAND // whole, 1) * whole if settings.difference == "co-located" else height
        difference = np.zeros((min(height, band), width), number)
        self._pixels = Pixels(plane, level, np.empty_like(plane), difference)
        self._see(first)
        self._pixels.reference[:] = level

    def _spikes(self, frame: Frame, last: Frame) -> np.ndarray:
        self._number += 1
        rule, tiles, pixels = self._rule, self._tiles, self._pixels
        seed = 0
        if rule.timing == RANDOM:
            # the frame's number sets the seed, so that skipped frames change nothing
            seed = int(np.random.SeedSequence((self.settings.seed, self._number)).generate_state(1, np.uint64)[0])
        new, old = bytes_of(frame), bytes_of(last)
        if rule.contrast or not _of_bytes(frame, self.settings):
            if not look(new, old, rule, tiles, pixels):
                return self._keys[0][:0]
            self._see(frame)
            new = new[:0]
        arguments = new, old, first_weight(frame), rule, tiles, pixels, frame.time - last.time, seed, self._keys[0]
        self._keys[0], count = kernels.step(*arguments)
        return self._keys[0][:count]

    def _see(self, frame: Frame) -> None:
        """Bring `plane` and `level` up to date where the frame changed."""
        settings, rule, tiles, pixels = self.settings, self._rule, self._tiles, self._pixels
        if _of_bytes(frame, settings):
            kernels.luminance(bytes_of(frame), first_weight(frame), rule, tiles.dirty, pixels.plane)
        elif tiles.dirty.any():
            pixels.plane[:] = perceived(settings, brightness(frame, settings.hue), pixels.plane.dtype)
        if rule.contrast:
            both = settings.mode == "LICE"
            kernels.contrast(pixels.plane, tiles.affected, both, float(rule.t_log), float(rule.slope), pixels.level)


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


def _of_bytes(frame: Frame, settings: Settings) -> bool:
    return frame.pixels.dtype == np.uint8 and not settings.hue


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
    found = np.empty(q.shape, np.float32)
    logarithm((1000 * q).astype(np.float32).ravel(), settings.t_log, _slope(settings), found.reshape(-1))
    return found


def _table(settings: Settings, first: Frame, number: Any) -> np.ndarray:
    """What each gray value, or each luminance in thousandths, is seen as; see `kernels.luminance`."""
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
