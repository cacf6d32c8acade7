"""Filters of events: refractory period, background activity, hot pixels."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from nvsdata.common.memory import allocated, zeros
from nvsdata.common.validation import microseconds, positive
from nvsdata.data.events import LATEST, Events, check_inside
from nvsdata.kernels.represent import filters as kernel
from nvsdata.transforms.apply import change_all


@dataclass(frozen=True)
class BackgroundActivity:
    """Drop events without company: no event of the eight pixels around, up to `window` earlier (Delbruck 2008).

    - `window`: in µs (default 10,000)

    Events of the same time count as earlier in the order that they have. Takes `Events`, a `Recording` or a list of
    them, gives `Events`. ValueError unless `window` is a positive whole number. tonic's `Denoise` looks at four
    pixels.
    """

    window: int = 10_000
    deterministic: ClassVar[bool] = True

    def __post_init__(self) -> None:
        microseconds("window", self.window)

    def __call__(self, sample: Any) -> Any:
        return change_all(sample, lambda events: background_activity(events, self.window))


@dataclass(frozen=True)
class HotPixels:
    """Drop all events of pixels with more than `rate` events per second, over the events' time (at least 1 µs).

    - `rate`: in events per second (default 1000)

    Takes `Events`, a `Recording` or a list of them, gives `Events`. ValueError unless `rate` is positive.
    """

    rate: float = 1000
    deterministic: ClassVar[bool] = True

    def __post_init__(self) -> None:
        positive("rate", self.rate)

    def __call__(self, sample: Any) -> Any:
        return change_all(sample, lambda events: drop_hot_pixels(events, self.rate))


def background_activity(events: Events, window: int = 10_000) -> Events:
    """Events with company; see `BackgroundActivity`."""
    t, x, y, _ = check_inside(events).columns
    shape = events.sensor_size[1] + 2, events.sensor_size[0] + 2
    settings = shape, min(int(window), LATEST)
    kept = allocated(events.sensor_size, shape, np.int64, lambda: kernel.in_company(t, x, y, *settings))
    return events.of(events.columns.take(kept))


def drop_hot_pixels(events: Events, rate: float = 1000) -> Events:
    """Events of pixels that aren't hot; see `HotPixels`."""
    counts = zeros(check_inside(events).sensor_size, events.sensor_size[::-1], np.int64)
    kernel.count_into(events.x, events.y, counts)
    most = rate * max(events.end - events.start, 1) / 1e6
    return events.of(events.columns.take(counts[events.y, events.x] <= most))
