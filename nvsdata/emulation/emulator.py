"""One run of PIX2NVS over frames of one size: the arrays that it remembers, and a step."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from nvsdata.events import Columns, Events, empty_columns
from nvsdata.kernels import emulate as kernels

if TYPE_CHECKING:
    from nvsdata.emulation.pix2nvs import PIX2NVS

METHODS = {"co-located": kernels.CO_LOCATED, "average": kernels.AVERAGE, "minimum": kernels.MINIMUM}
# linear times need no key: they follow from the raster order
TIMINGS = {"interpolated": kernels.INTERPOLATED, "random": kernels.RANDOM}
LONGEST = 2**31  # µs between frames that keys can hold
LARGEST = 2**15 - 1  # pixels of a side


class Emulator:
    """State of an emulation. Frames are bytes in b, g, r order or grey, or float brightness 0 to 255."""

    def __init__(self, settings: PIX2NVS, first: np.ndarray) -> None:
        height, width = first.shape[:2]
        if settings.inhibition > min(height, width):
            raise ValueError(f"inhibition={settings.inhibition} is larger than the frame of {width}x{height}")
        if max(height, width) > LARGEST:
            raise ValueError(f"frames of {width}x{height} are larger than events can address")
        self.settings, self.sensor_size = settings, (width, height)
        self._kind = (first.shape, first.dtype)
        self._channels = first.shape[2] if first.ndim == 3 else 1
        tiles = (-(-height // kernels.TILE[0]), -(-width // kernels.TILE[1]))
        self._dirty, self._affected, self._active = (np.ones(tiles, bool) for _ in range(3))
        self._still, self._behind = np.zeros(tiles, bool), np.zeros(tiles, np.int64)
        number = _precision(settings)
        self._table = tone(settings, np.arange(kernels.TABLE_SIZE) / 1000).astype(number)
        self._threshold = number(settings.threshold)
        self._alpha = number(settings.alpha if settings.exp else 1)
        self._sensitivity = _sensitivity(settings, (height, width)).astype(number)
        self._calm = self._threshold / max(number(1), self._sensitivity.max(initial=0))
        self._number = 0
        self._previous = self._bytes(first).copy()
        self._plane = np.empty((height, width), number)
        self._level = self._plane if settings.mode == "LI" else np.empty_like(self._plane)
        self._see(first)
        self._reference = self._level.copy()
        self._difference = np.zeros_like(self._plane)
        self._keys = np.empty(height * width + 64 * width, np.uint64)
        self._spare = self._keys[:0]

    def step(self, frame: np.ndarray, before: int, now: int) -> Events:
        """Events between the last frame, at `before` µs, and this one, at `now` µs.

        ValueError for a frame of other size or type than the first, and times that don't rise.
        """
        if (frame.shape, frame.dtype) != self._kind:
            now_is, was = (f"{shape[1]}x{shape[0]} {kind}" for shape, kind in ((frame.shape, frame.dtype), self._kind))
            raise ValueError(f"the frame at {now} µs is {now_is} {frame.shape}, earlier ones were {was}")
        if not 0 < now - before < LONGEST:
            raise ValueError(f"the frame at {now} µs follows the one at {before} µs: times must rise, by under 35 min")
        settings = self.settings
        self._number += 1
        dirty = kernels.find_dirty(
            self._bytes(frame), self._previous, self._row_items(frame), self.sensor_size[::-1], self._dirty
        )
        if dirty == 0 and self._still.all():
            self._behind += self._falls_behind
            return Events.empty(self.sensor_size, before)
        self._wake()
        kernels.catch_up(self._reference, self._level, self._alpha, self._behind, self._active)
        if dirty:
            self._see(frame)
        method = METHODS[settings.difference]
        kernels.differ(self._level, self._reference, method, self._sensitivity, self._active, self._difference)
        if settings.inhibition > 1:
            kernels.inhibit(self._difference, settings.inhibition, self._active)
        count = self._fire(now - before)
        kernels.update(
            self._level,
            self._reference,
            self._difference,
            self._threshold,
            self._alpha,
            settings.new,
            method,
            self._calm,
            self._active,
            self._still,
            self._behind,
        )
        return self._events(count, before, now)

    @property
    def _falls_behind(self) -> bool:
        return bool(self.settings.new and self._alpha < 1)

    def _bytes(self, frame: np.ndarray) -> np.ndarray:
        """The frame's bytes, [H, bytes of a row]."""
        return np.ascontiguousarray(frame).view(np.uint8).reshape(frame.shape[0], -1)

    def _row_items(self, frame: np.ndarray) -> int:
        """Bytes of a pixel."""
        return self._channels * frame.dtype.itemsize

    def _wake(self) -> None:
        """Which tiles have to be looked at: changed ones, restless ones, and neighbours that matter."""
        dirty = self._dirty
        if self.settings.mode != "LI":
            kernels.spread(self._dirty, self._affected)
            dirty = self._affected
        np.logical_not(self._still, out=self._active)
        self._active |= dirty
        if self.settings.difference != "co-located":
            kernels.spread(self._active.copy(), self._active)
        if kernels.TILE[0] % self.settings.inhibition:
            # blocks lie across tiles
            self._active[:] = True

    def _see(self, frame: np.ndarray) -> None:
        """Bring `plane` and `level` up to date where the frame changed."""
        settings = self.settings
        if frame.dtype == np.uint8 and not settings.hue:
            kernels.luminance(self._previous, self._channels, self._table, self._dirty, self._plane)
        else:
            self._plane[:] = tone(settings, brightness(frame, settings.hue))
        if settings.mode != "LI":
            affected = self._affected
            slope = _slope(settings)
            kernels.contrast(self._plane, affected, settings.mode == "LICE", settings.t_log, slope, self._level)

    def _fire(self, span: int) -> int:
        timing = TIMINGS.get(self.settings.timestamps, kernels.AT_ONCE)
        # of the frame's number, so that frames that are skipped change nothing
        seed = np.random.SeedSequence((self.settings.seed, self._number)).generate_state(1, np.uint64)[0]
        count, row, height = 0, 0, self.sensor_size[1]
        while True:
            count, row = kernels.fire(
                self._difference,
                self._active,
                self._threshold,
                self.settings.max_events,
                float(span),
                timing,
                seed,
                self._keys,
                count,
                row,
            )
            if row == height:
                return int(count)
            self._keys = np.concatenate((self._keys, np.empty_like(self._keys)))

    def _events(self, count: int, before: int, now: int) -> Events:
        if count == 0:
            return Events.empty(self.sensor_size, before)
        keys, start = self._keys[:count], before
        if self.settings.timestamps in TIMINGS:
            if self._spare.size < count:
                self._spare = np.empty_like(self._keys)
            keys = kernels.sort_keys(keys, self._spare[:count], int(now - before).bit_length())
        columns = Columns(*(np.empty(count, column.dtype) for column in empty_columns()))
        kernels.unpack(keys, start, *columns)
        if self.settings.timestamps == "fixed":
            columns.t[:] = now
        elif self.settings.timestamps == "linear":
            columns.t[:] = before + np.arange(1, count + 1) * (now - before) // count
        return Events.trusted(columns, self.sensor_size, before)


def brightness(frame: np.ndarray, hue: bool = False) -> np.ndarray:
    """Luminance q or hue h (3.2.1), float64 [H, W], of a frame in b, g, r order or grey; black has hue 0."""
    values = frame.astype(np.float64)
    if values.ndim == 2:
        return np.where(values > 0, 0.5, 0.0) if hue else values
    b, g, r = values[..., 0], values[..., 1], values[..., 2]
    if hue:
        return np.divide(b, r + g, out=b.copy(), where=r + g > 0)
    return (299 * r + 587 * g + 114 * b) / 1000


def tone(settings: PIX2NVS, q: np.ndarray) -> np.ndarray:
    """Of brightness q: (3.1) for mode LI, else the perceptual luminance that (3.2) starts from."""
    if settings.mode != "LI":
        return 100 * np.sqrt((q / 255) ** settings.gamma)
    with np.errstate(divide="ignore"):
        return np.where(q > settings.t_log, np.log(q), q * _slope(settings))


def _slope(settings: PIX2NVS) -> float:
    """Of the linear part of (3.1)."""
    return float(np.log(settings.t_log) / settings.t_log) if settings.continuous and settings.t_log else 1.0


def _precision(settings: PIX2NVS) -> Any:
    """float32 where its rounding shifts no event by a µs at 25 frames a second: logarithms and no tiny threshold."""
    plain = settings.mode == "LI" and settings.t_log <= 32
    return np.float32 if plain and settings.threshold >= 0.05 else np.float64


def _sensitivity(settings: PIX2NVS, shape: tuple[int, int]) -> np.ndarray:
    """Nominal over own threshold of each pixel, [H, W]; empty if all are alike. None is below a tenth."""
    if settings.mismatch == 0:
        return np.empty((0, 0))
    spread = np.random.default_rng((settings.seed, 2)).normal(1, settings.mismatch, shape)
    return np.asarray(1 / np.maximum(spread, 0.1))
