"""Filters of events: refractory period, background activity, hot pixels."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from nvsdata.common.validation import microseconds, positive
from nvsdata.data.events import LATEST, Events
from nvsdata.kernels import filters as kernel
from nvsdata.transforms.together import change_all


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
    t, x, y, _ = events.columns
    return events.of(events.columns.take(kernel.in_company(t, x, y, events.sensor_size, min(int(window), LATEST))))


def drop_hot_pixels(events: Events, rate: float = 1000) -> Events:
    """Events of pixels that aren't hot; see `HotPixels`."""
    most = rate * max(events.end - events.start, 1) / 1e6
    hot = kernel.counts(events.x, events.y, events.sensor_size) > most
    return events.of(events.columns.take(~hot[events.y, events.x]))
