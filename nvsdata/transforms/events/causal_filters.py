"""Samplers that look back only: what they keep depends on no later event, so they work on streams, too."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from nvsdata.common.memory import zeros
from nvsdata.common.validation import microseconds, positive, whole
from nvsdata.data.events import LATEST, Events, check_inside
from nvsdata.kernels.represent.filters import NEVER, after_pause, first_of_boxes, within_rate
from nvsdata.transforms.apply import change_all

Sieve = Callable[[Events], Events]
"""Takes the next events of a stream, and gives those that are kept."""


class LookingBack(ABC):
    """A sampler that looks back only.

    As a transform, it takes `Events`, a `Recording` or a list of them, and gives `Events`; `begin(sensor_size)` gives a
    function that keeps the same events of a stream, however it is cut.
    """

    deterministic: ClassVar[bool] = True

    @abstractmethod
    def _places(self, width: int, height: int) -> Callable[..., np.ndarray]:
        """What gives the mask of events to keep, of t, x and y, and remembers them."""

    def begin(self, sensor_size: tuple[int, int]) -> Sieve:
        """A function that takes the next events of a stream and gives those that are kept.

        ValueError, from that function, for events outside the sensor.
        """
        chosen = self._places(*sensor_size)

        def sieve(events: Events) -> Events:
            t, x, y, _ = check_inside(events, sensor_size).columns
            return events.of(events.columns.take(chosen(t, x, y)))

        return sieve

    def __call__(self, sample: Any) -> Any:
        return change_all(sample, lambda events: self.begin(events.sensor_size)(events))


@dataclass(frozen=True)
class RefractoryPeriod(LookingBack):
    """Drop events less than `period` after the last one of their pixel that was kept, of either polarity.

    - `period`: in µs

    See `LookingBack` for what it takes and gives. ValueError unless `period` is a positive whole
    number. tonic's `RefractoryPeriod` counts from the last event, kept or not, and drops one exactly `period` after it.
    """

    period: int

    def __post_init__(self) -> None:
        microseconds("period", self.period)

    def _places(self, width: int, height: int) -> Callable[..., np.ndarray]:
        last, period = zeros((width, height), (height, width), np.int64, NEVER), min(int(self.period), LATEST)
        return lambda t, x, y: after_pause(t, x, y, period, last)


@dataclass(frozen=True)
class FirstOfBoxes(LookingBack):
    """Keep the first `k` events of each box of `side` x `side` pixels and `duration`.

    What `NonUniformSample` does with boxes that follow the events of a whole window, by boxes that are known before.

    - `k`: events per box (default 1)
    - `side`: in pixels, boxes begin at the top left (default 4)
    - `duration`: in µs, boxes begin at multiples of it in the recording's clock (default 10,000)

    See `LookingBack` for what it takes and gives. ValueError unless all are positive whole numbers.
    """

    k: int = 1
    side: int = 4
    duration: int = 10_000

    def __post_init__(self) -> None:
        whole("k", self.k, 1)
        whole("side", self.side, 1)
        microseconds("duration", self.duration)

    def _places(self, width: int, height: int) -> Callable[..., np.ndarray]:
        shape = -(-height // self.side), -(-width // self.side)
        box, count = zeros((width, height), shape, np.int64, NEVER), zeros((width, height), shape, np.int64)
        limits = int(self.side), min(int(self.duration), LATEST), int(self.k)
        return lambda t, x, y: first_of_boxes(t, x, y, *limits, box, count)


@dataclass(frozen=True)
class RateLimit(LookingBack):
    """Keep so many events that no place of `side` x `side` pixels exceeds a rate: all where little happens.

    A place that was quiet may have `burst` events at once (the leaky bucket of networks of computers).

    - `rate`: events per second and place
    - `side`: of a place in pixels, the first begins at the top left (default 4)
    - `burst`: events (default 4)

    See `LookingBack` for what it takes and gives. ValueError for a rate that isn't positive, or above one per µs, and
    unless the others are positive whole numbers.
    """

    rate: float
    side: int = 4
    burst: int = 4

    def __post_init__(self) -> None:
        positive("rate", self.rate)
        if self.rate > 1e6:
            raise ValueError(f"rate must be at most 1e6, one event per µs, not {self.rate}")
        whole("side", self.side, 1)
        whole("burst", self.burst, 1)

    def _places(self, width: int, height: int) -> Callable[..., np.ndarray]:
        shape = -(-height // self.side), -(-width // self.side)
        due = zeros((width, height), shape, np.int64, NEVER)
        # whole numbers, so that any cut gives the same
        interval = min(round(1e6 / self.rate), LATEST // (2 * self.burst))
        return lambda t, x, y: within_rate(t, x, y, int(self.side), interval, int(self.burst), due)


def refractory_period(events: Events, period: int) -> Events:
    """Events that aren't too soon after another of their pixel; see `RefractoryPeriod`."""
    found: Events = RefractoryPeriod(period)(events)
    return found


def first_of_each_box(events: Events, k: int = 1, *, side: int = 4, duration: int = 10_000) -> Events:
    """The first events of each space-time box; see `FirstOfBoxes`."""
    found: Events = FirstOfBoxes(k, side, duration)(events)
    return found


def limit_rate(events: Events, rate: float, *, side: int = 4, burst: int = 4) -> Events:
    """Events by which no place exceeds a rate; see `RateLimit`."""
    found: Events = RateLimit(rate, side, burst)(events)
    return found
