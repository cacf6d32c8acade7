"""State of a PIX2NVS emulation: its arrays, and the step from one frame to the next."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any

import numpy as np

from nvsdata.emulation.settings import PIX2NVSSettings
from nvsdata.emulation.state import KEYED, EmulatorState, brightness, first_weight, frame_bytes
from nvsdata.kernels.emulate import pix2nvs as kernels
from nvsdata.kernels.emulate.frames import TILE, logarithm
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
    mark_tiles,
)
from nvsdata.video.video_frame import VideoFrame, stretch_levels

METHODS = {"co-located": CO_LOCATED, "average": AVERAGE, "minimum": MINIMUM}
TIMINGS = dict(zip(KEYED, (INTERPOLATED, RANDOM), strict=True))
BAND = 4 * TILE[0]  # rows that are processed at a time where no pixel depends on its neighbors


class PIX2NVSState(EmulatorState):
    """State of an emulation by `PIX2NVS`; `EmulatorState` describes the parameters.

    The constructor raises ValueError if the frame is smaller than `inhibition`, or larger than events can address.
    """

    def __init__(self, settings: PIX2NVSSettings, first: VideoFrame) -> None:
        super().__init__(settings, first, settings.timestamps)
        height, width = first.pixels.shape[:2]
        if settings.inhibition > min(height, width):
            raise ValueError(f"inhibition={settings.inhibition} is larger than the frame of {width}x{height}")
        self.settings = settings
        self._of_bytes = first.pixels.dtype == np.uint8 and not settings.hue
        number = _precision(settings)
        tiles = (-(-height // TILE[0]), -(-width // TILE[1]))
        dirty, active, still = (np.full(tiles, value) for value in (True, True, False))
        affected = dirty if settings.mode == "LI" else dirty.copy()
        self._tiles = Tiles(dirty, affected, active, still, np.zeros(tiles, np.int64))
        self._rule = _rule(settings, (height, width), number, _table(settings, first, number))
        self._number = 0
        plane = np.empty((height, width), number)
        level = plane if settings.mode == "LI" else np.empty_like(plane)
        # a band consists of whole tiles and whole blocks of inhibition
        whole = math.lcm(TILE[0], settings.inhibition)
        band = max(BAND // whole, 1) * whole if settings.difference == "co-located" else height
        difference = np.zeros((min(height, band), width), number)
        self._pixels = Pixels(plane, level, np.empty_like(plane), difference)
        self._see(first)
        self._pixels.reference[:] = level

    def _spikes(self, frame: VideoFrame, last: VideoFrame) -> np.ndarray:
        self._number += 1
        rule, tiles, pixels = self._rule, self._tiles, self._pixels
        seed = 0
        if rule.timing == RANDOM:
            # the frame's number sets the seed, so that skipped frames change nothing
            seed = int(np.random.SeedSequence((self.settings.seed, self._number)).generate_state(1, np.uint64)[0])
        new, old = frame_bytes(frame), frame_bytes(last)
        if rule.contrast or not self._of_bytes:
            if not mark_tiles(new, old, rule, tiles, pixels):
                return self._keys[0][:0]
            self._see(frame)
            new = new[:0]
        arguments = new, old, first_weight(frame), rule, tiles, pixels, frame.time - last.time, seed, self._keys[0]
        self._keys[0], count = kernels.step(*arguments)
        return self._keys[0][:count]

    def _see(self, frame: VideoFrame) -> None:
        """Update `plane` and `level` where the frame changed."""
        settings, rule, tiles, pixels = self.settings, self._rule, self._tiles, self._pixels
        if self._of_bytes:
            kernels.luminance(frame_bytes(frame), first_weight(frame), rule, tiles.dirty, pixels.plane)
        elif tiles.dirty.any():
            pixels.plane[:] = perceived(settings, brightness(frame, settings.hue), pixels.plane.dtype)
        if rule.contrast:
            both = settings.mode == "LICE"
            kernels.contrast(pixels.plane, tiles.affected, both, float(rule.t_log), float(rule.slope), pixels.level)


def _rule(settings: PIX2NVSSettings, shape: tuple[int, int], number: Any, table: np.ndarray) -> Rule:
    """Return the settings in the form that the kernels take."""
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
        # slightly below the threshold, so that rounding never lets a pixel of a still tile reach it
        calm=threshold / max(number(1), sensitivity.max(initial=0)) * (1 - 4 * np.finfo(number).eps),
    )


def tone(settings: PIX2NVSSettings, q: np.ndarray) -> np.ndarray:
    """Return the pixel value of brightness q (0 to 255).

    In mode LI, that is the logarithm (thesis, eq. 3.1). In modes CE and LICE, it is the perceptual luminance from which
    the contrast (thesis, eq. 3.2) is computed.
    """
    if settings.mode != "LI":
        return 100 * np.sqrt((q / 255) ** settings.gamma)
    with np.errstate(divide="ignore"):
        return np.where(q > settings.t_log, np.log(q), q * _slope(settings))


def perceived(settings: PIX2NVSSettings, q: np.ndarray, number: Any) -> np.ndarray:
    """Return `tone` in the emulation's type `number`; in float32, the kernel computes the logarithm."""
    if number != np.float32:
        return tone(settings, q)
    found = np.empty(q.shape, np.float32)
    logarithm((1000 * q).astype(np.float32).ravel(), settings.t_log, _slope(settings), found.reshape(-1))
    return found


def _table(settings: PIX2NVSSettings, first: VideoFrame, number: Any) -> np.ndarray:
    """Return the pixel value of each gray byte, or of each luminance in thousandths; see `kernels.luminance`."""
    if first.pixels.ndim == 2:
        return perceived(settings, stretch_levels(np.arange(256), first.levels), number)
    # logarithms in float32 have no table: computing them is faster than looking them up
    return np.empty(0, np.float32) if number is np.float32 else _tone_table(settings)


@lru_cache(8)
def _tone_table(settings: PIX2NVSSettings) -> np.ndarray:
    """Return `tone` of luminance in thousandths; it is cached, because all videos of a folder use the same."""
    return tone(settings, np.arange(kernels.TABLE_SIZE) / 1000)


def _slope(settings: PIX2NVSSettings) -> float:
    """Return the slope of the linear part of the logarithm (thesis, eq. 3.1)."""
    return float(np.log(settings.t_log) / settings.t_log) if settings.continuous and settings.t_log else 1.0


def _precision(settings: PIX2NVSSettings) -> Any:
    """Return float32 where its rounding shifts no event by 1 µs at 25 frames/s, else float64.

    float32 suffices in mode LI unless `t_log` is large, or `threshold` or `alpha` is small. A moving average in float32
    stays up to 2^-22 / alpha away from its level, because smaller steps are lost.
    """
    plain = settings.mode == "LI" and settings.t_log <= 32
    follows = not settings.exp or settings.alpha >= 0.01
    return np.float32 if plain and follows and settings.threshold >= 0.05 else np.float64


def _sensitivity(settings: PIX2NVSSettings, shape: tuple[int, int]) -> np.ndarray:
    """Return the nominal threshold divided by each pixel's threshold, [H, W]; empty if all are equal.

    No pixel's threshold is below a tenth of the nominal one.
    """
    if settings.mismatch == 0:
        return np.empty((0, 0))
    spread = np.random.default_rng((settings.seed, 2)).normal(1, settings.mismatch, shape)
    return np.asarray(1 / np.maximum(spread, 0.1))
