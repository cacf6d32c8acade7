"""Changes of the events' times."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
import torch

from nvsdata.common.validation import factors, not_negative, positive, probability
from nvsdata.data.events import LATEST, Columns, Events, sort_by_time
from nvsdata.kernels.decode.order import moved
from nvsdata.transforms.apply import change_all, decoded
from nvsdata.transforms.rng import generator, uniform


@dataclass(frozen=True)
class RelativeTime:
    """Times count from the beginning of the events' time (`Events.start`), which becomes 0.

    Takes `Events`, a `Recording` or a list of them, each of which then begins at 0; gives `Events`.
    """

    deterministic: ClassVar[bool] = True

    def __call__(self, sample: Any) -> Any:
        return change_all(sample, relative_time)


@dataclass(frozen=True)
class RandomTimeScale:
    """Time runs faster or slower, by a random factor from [low, high), from the beginning of the events' time on.

    - `low`: smallest factor, above 0 (default 0.8)
    - `high`: largest factor, at least `low` (default 1.2)

    Takes `Events`, a `Recording` or a list of them, which get the same factor from the first one's beginning on; gives
    `Events`. ValueError for settings out of range.
    """

    low: float = 0.8
    high: float = 1.2

    def __post_init__(self) -> None:
        factors(self.low, self.high)

    def __call__(self, sample: Any) -> Any:
        factor = uniform(self.low, self.high)
        parts, listed = decoded(sample)
        return change_all(parts, lambda events: scale_time(events, factor, listed[0].start))


@dataclass(frozen=True)
class RandomTimeFlip:
    """Events run backwards, with probability `p`: ON becomes OFF, because what got brighter gets darker.

    - `p`: probability (default 0.5)

    Takes `Events`, a `Recording` or a list of them, whose order is reversed, too; gives `Events`. ValueError unless `p`
    is a probability.
    """

    p: float = 0.5

    def __post_init__(self) -> None:
        probability("p", self.p)

    def __call__(self, sample: Any) -> Any:
        flipped = uniform(0, 1) < self.p
        parts, listed = decoded(sample)
        if not (flipped and listed):
            return parts
        about = listed[0].start + max(part.end for part in listed)
        backwards = [flip_time(part, about) for part in reversed(listed)]
        return backwards if isinstance(parts, list) else backwards[0]


@dataclass(frozen=True)
class TimeJitter:
    """Times move at random, by a normal distribution, rounded to µs; events are sorted again.

    - `sigma`: standard deviation in µs (default 100.0)

    No event leaves the events' time (`Events.start` to `end`). Takes `Events`, a `Recording` or a list of them, gives
    `Events`. ValueError for a negative `sigma`.
    """

    sigma: float = 100.0

    def __post_init__(self) -> None:
        not_negative("sigma", self.sigma)

    def __call__(self, sample: Any) -> Any:
        return change_all(sample, lambda events: jitter_time(events, self.sigma))


def relative_time(events: Events) -> Events:
    """Events whose time begins at 0; see `RelativeTime`. ValueError for times that become 2^62 µs or more."""
    if events.end - events.start >= LATEST:
        raise ValueError(f"times of {events!r} don't fit if they count from their beginning")
    return _at(events, events.t - events.start, 0, events.end - events.start)


def scale_time(events: Events, factor: float, origin: int | None = None) -> Events:
    """Events at `factor` times their distance from `origin` (µs; default `Events.start`), rounded to µs.

    ValueError unless `factor` is positive, and for times that become 2^62 µs or more.
    """
    positive("factor", factor)
    origin = events.start if origin is None else origin
    if factor * max(abs(events.end - origin), abs(events.start - origin)) + abs(origin) >= LATEST:
        raise ValueError(f"times of {events!r} don't fit after scaling by {factor}")

    def scaled(t: Any) -> Any:
        return origin + np.rint((t - origin) * factor).astype(np.int64)

    return _at(events, scaled(events.t), int(scaled(np.array(events.start))), int(scaled(np.array(events.end))))


def flip_time(events: Events, about: int | None = None) -> Events:
    """Events backwards in time, with the other polarity: t becomes `about` - t (default `start` + `end`)."""
    about = events.start + events.end if about is None else about
    t, x, y, p = events.columns
    columns = Columns((about - t)[::-1].copy(), x[::-1].copy(), y[::-1].copy(), 1 - p[::-1])
    return Events.trusted(columns, events.sensor_size, about - events.end, about - events.start)


def jitter_time(events: Events, sigma: float) -> Events:
    """Events at times that moved at random; see `TimeJitter`."""
    t, *others = events.columns
    moves = torch.randn(len(events), generator=generator()).numpy()
    times = moved(t, moves, float(sigma), events.start, events.end)
    return events.of(sort_by_time(Columns(times, *others)))


def _at(events: Events, t: np.ndarray, start: int, end: int) -> Events:
    _, *others = events.columns
    return Events.trusted(Columns(t, *others), events.sensor_size, start, end)
