"""Imperfections of real sensors: noise, hot pixels, the refractory period, a slow readout."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from nvsdata.data.events import Columns, Events, sort_by_time
from nvsdata.kernels.emulate.frames import read_out

AT_WHITE = 0.25  # noise of a white pixel relative to that of a black one, as in v2e (Hu, Liu, Delbruck 2021)


class ImperfectSensor(Protocol):
    """Settings of a sensor's imperfections; `PIX2NVS` describes them."""

    @property
    def noise_rate(self) -> float: ...
    @property
    def hot_pixels(self) -> float: ...
    @property
    def hot_rate(self) -> float: ...
    @property
    def refractory(self) -> int: ...
    @property
    def bandwidth(self) -> float: ...
    @property
    def seed(self) -> int: ...


class Imperfections:
    """State of a sensor's imperfections during a recording.

    `counts` has the numbers of events so far that "noise" and "hot_pixels" added and that "refractory" removed.

    Args:
        settings: An emulator.
        sensor_size: (width, height) in pixels.
    """

    def __init__(self, settings: ImperfectSensor, sensor_size: tuple[int, int]) -> None:
        self.settings, self.size = settings, sensor_size
        self._random = np.random.default_rng((settings.seed, 3))
        pixels = sensor_size[0] * sensor_size[1]
        self._hot = self._random.permutation(pixels)[: round(settings.hot_pixels * pixels)]
        # long before any event, so that each pixel can fire at once
        self._ready = np.full(pixels, -(2**62), np.int64)
        self._gap = 1e6 / settings.bandwidth if settings.bandwidth else 0.0
        self._busy = 0.0
        self.counts = dict.fromkeys(("noise", "hot_pixels", "refractory"), 0)

    @classmethod
    def of(cls, settings: ImperfectSensor, sensor_size: tuple[int, int]) -> Imperfections | None:
        """Return the imperfections of these settings; None for an ideal sensor."""
        some = settings.noise_rate or settings.hot_pixels or settings.refractory or settings.bandwidth
        return cls(settings, sensor_size) if some else None

    def apply(self, events: Events, before: int, now: int, light: np.ndarray | None = None) -> Events:
        """Return the events with noise, hot pixels, the refractory period and the readout.

        If events come faster than the readout passes them on, some are read after `now`.

        Args:
            events: Ideal events from `before` to `now`.
            before: Start of the interval in µs.
            now: End of the interval in µs.
            light: Brightness [H, W] from 0 (black) to 1 (white); noise falls linearly with it, down to `AT_WHITE`.
        """
        settings = self.settings
        seconds = (now - before) / 1e6
        pixels = self.size[0] * self.size[1]
        noisy = self._random.poisson(settings.noise_rate * seconds * pixels)
        hot = self._random.poisson(settings.hot_rate * seconds * self._hot.size)
        where = self._random.integers(0, pixels, noisy)
        if light is not None:
            where = where[self._random.random(noisy) < 1 - (1 - AT_WHITE) * light.ravel()[where]]
            noisy = where.size
        if hot:
            where = np.concatenate((where, self._hot[self._random.integers(0, self._hot.size, hot)]))
        self.counts["noise"] += int(noisy)
        self.counts["hot_pixels"] += int(hot)
        polarity = np.ones(noisy + hot, np.uint8)
        polarity[:noisy] = self._random.integers(0, 2, noisy)
        times = self._random.integers(before, now, noisy + hot)
        extra = Columns(times, where % self.size[0], where // self.size[0], polarity)
        joined = [
            np.concatenate((ours, more.astype(ours.dtype))) for ours, more in zip(events.columns, extra, strict=True)
        ]
        columns = sort_by_time(Columns(*joined))
        if settings.refractory or settings.bandwidth:
            times, kept, self._busy = read_out(
                columns.t,
                columns.x,
                columns.y,
                self.size[0],
                self._ready,
                settings.refractory,
                self._gap,
                self._busy,
                before,
            )
            self._busy -= now - before
            self.counts["refractory"] += columns.t.size - int(np.count_nonzero(kept))
            columns = columns._replace(t=times).take(kept)
        last = int(columns.t[-1]) if columns.t.size else now
        return Events.trusted(columns, self.size, before, max(now, last))
