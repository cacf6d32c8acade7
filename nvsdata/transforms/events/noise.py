"""Events that move, come or go at random."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch

from nvsdata.common.validation import not_negative, probability, whole
from nvsdata.data.events import Columns, Events, sort_by_time
from nvsdata.data.recording import Recording, as_events
from nvsdata.kernels.represent.filters import in_rectangle
from nvsdata.transforms.apply import change_all, decoded
from nvsdata.transforms.rng import generator, place, randint


@dataclass(frozen=True)
class SpatialJitter:
    """Events move at random along both axes, by a normal distribution, rounded to pixels.

    - `sigma`: standard deviation in pixels (default 1.0)

    Those that leave the sensor are dropped. Takes `Events`, a `Recording` or a list of them, gives `Events`. ValueError
    for a negative `sigma`.
    """

    sigma: float = 1.0

    def __post_init__(self) -> None:
        not_negative("sigma", self.sigma)

    def __call__(self, sample: Any) -> Any:
        return change_all(sample, lambda events: jitter_space(events, self.sigma))


@dataclass(frozen=True)
class UniformNoise:
    """Add events at random pixels and times, of random polarity.

    - `count`: number of events, of each of a list's (default 100)

    Times are those of the events (`Events.start` to `end`); of equal times the new events come last. Takes `Events`, a
    `Recording` or a list of them, gives `Events`. ValueError unless `count` is a whole number, not negative.
    """

    count: int = 100

    def __post_init__(self) -> None:
        whole("count", self.count)

    def __call__(self, sample: Any) -> Any:
        return change_all(sample, lambda events: add_noise(events, int(self.count)))


@dataclass(frozen=True)
class DropByTime:
    """Drop all events of an interval at a random place.

    - `share`: its length, as a share of the events' time (default 0.2)

    Takes `Events` or a `Recording`, gives `Events`; of a list, it's one interval of the whole time. ValueError unless
    `share` lies between 0 and 1.
    """

    share: float = 0.2

    def __post_init__(self) -> None:
        probability("share", self.share)

    def __call__(self, sample: Any) -> Any:
        parts, listed = decoded(sample)
        if not listed:
            return parts
        start = listed[0].start
        moments = max(part.end for part in listed) - start + 1
        length = min(round(self.share * moments), moments)
        begin = start + randint(moments - length + 1)
        return change_all(parts, lambda events: drop_interval(events, begin, begin + length))


@dataclass(frozen=True)
class DropByArea:
    """Drop all events of a rectangle at a random place, which has the sensor's proportions.

    - `share`: its area, as a share of the sensor's (default 0.2)

    Takes `Events`, a `Recording` or a list of them, all of one sensor, which lose the same rectangle; gives `Events`.
    ValueError unless `share` lies between 0 and 1.
    """

    share: float = 0.2

    def __post_init__(self) -> None:
        probability("share", self.share)

    def __call__(self, sample: Any) -> Any:
        parts, listed = decoded(sample)
        if not listed:
            return parts
        sensor = listed[0].sensor_size
        width, height = (round(side * math.sqrt(self.share)) for side in sensor)
        x, y = (randint(side - cut + 1) for side, cut in zip(sensor, (width, height), strict=True))
        return change_all(parts, lambda events: drop_rectangle(events, x, y, width, height))


@dataclass(frozen=True)
class RandomRun:
    """`count` consecutive events from a random place; all, if there are no more.

    - `count`: number of events (default 10,000)

    Takes `Events` or a `Recording`, gives `Events`. ValueError unless `count` is a positive whole number.
    """

    count: int = 10_000

    def __post_init__(self) -> None:
        whole("count", self.count, 1)

    def __call__(self, sample: Events | Recording) -> Events:
        events = as_events(sample)
        first = place(max(len(events) - int(self.count), 0) + 1)
        return events if len(events) <= int(self.count) else events[first : first + int(self.count)]


def jitter_space(events: Events, sigma: float) -> Events:
    """Events at pixels that moved at random; see `SpatialJitter`."""
    moves = torch.randn(2, len(events), generator=generator()).numpy() * np.float32(min(sigma, 1e9))
    width, height = events.sensor_size
    x, y = events.x + np.rint(moves[0]), events.y + np.rint(moves[1])
    inside = (x >= 0) & (x < width) & (y >= 0) & (y < height)
    x, y = x[inside].astype(np.int16), y[inside].astype(np.int16)
    return events.of(Columns(events.t[inside], x, y, events.p[inside]))


def add_noise(events: Events, count: int) -> Events:
    """Events and `count` random ones; see `UniformNoise`."""
    draw = generator()
    high = (events.end - events.start + 1, *events.sensor_size, 2)
    new = [torch.randint(bound, (count,), generator=draw).numpy() for bound in high]
    new[0] += events.start
    joined = [np.concatenate((old, more.astype(old.dtype))) for old, more in zip(events.columns, new, strict=True)]
    return events.of(sort_by_time(Columns(*joined)))


def drop_interval(events: Events, start: int, stop: int) -> Events:
    """Events without those at start <= t < stop (µs)."""
    return events.of(events.columns.take((events.t < start) | (events.t >= stop)))


def drop_rectangle(events: Events, x: int, y: int, width: int, height: int) -> Events:
    """Events without those of a rectangle, whose upper left pixel is (x, y)."""
    return events.of(events.columns.take(~in_rectangle(events.x, events.y, x, y, width, height)))
