"""Causal filters of events, for recordings and streams: earlier events alone decide if an event is kept."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from nvsdata.common.memory import zeros
from nvsdata.common.validation import microseconds, positive, whole
from nvsdata.data.events import LATEST, Events, check_inside
from nvsdata.kernels.represent.filters import NEVER, first_of_boxes, not_refractory, within_rate
from nvsdata.transforms.apply import map_sample

StreamFilter = Callable[[Events], Events]
"""Function that takes the next events of a stream and returns those that are kept."""


class CausalFilter(ABC):
    """Filter in which earlier events alone decide if an event is kept or dropped.

    As a transform, it takes `Events`, a `Recording` or a list of them, and returns `Events`. For a stream,
    `begin(sensor_size)` returns a function that keeps the same events, no matter how the stream is cut.
    """

    deterministic: ClassVar[bool] = True

    @abstractmethod
    def _masks(self, width: int, height: int) -> Callable[..., np.ndarray]:
        """Return a function of t, x, y and p of the next events that returns the mask of those to keep."""

    def begin(self, sensor_size: tuple[int, int]) -> StreamFilter:
        """Return a function that takes the next events of a stream and returns those that are kept.

        Args:
            sensor_size: (width, height) in pixels. The function raises a ValueError for events outside.
        """
        mask = self._masks(*sensor_size)

        def keep(events: Events) -> Events:
            columns = check_inside(events, sensor_size).columns
            return events.of(events.columns.take(mask(*columns)))

        return keep

    def __call__(self, sample: Any) -> Any:
        return map_sample(sample, lambda events: self.begin(events.sensor_size)(events))


@dataclass(frozen=True)
class RefractoryPeriod(CausalFilter):
    """Drop events less than `period` after the last kept event of their pixel, of either polarity.

    tonic's `RefractoryPeriod` counts from the last event, kept or not, and drops one exactly `period` after it.

    Args:
        period: Duration in µs.

    Returns:
        `Events`. The call takes `Events`, a `Recording` or a list of them; for streams, see `begin`.

    Raises:
        ValueError: `period` isn't a positive integer.

    Example:
        >>> from nvsdata import Events, transforms as T
        >>> events = Events([0, 10, 30, 50], [1, 1, 1, 2], [1, 1, 1, 1], [1, 0, 1, 1], (4, 4))
        >>> T.RefractoryPeriod(20)(events).t.tolist()
        [0, 30, 50]
    """

    period: int

    def __post_init__(self) -> None:
        microseconds("period", self.period)

    def _masks(self, width: int, height: int) -> Callable[..., np.ndarray]:
        last, period = zeros((width, height), (height, width), np.int64, NEVER), min(int(self.period), LATEST)
        return lambda t, x, y, p: not_refractory(t, x, y, period, last)


@dataclass(frozen=True)
class FirstOfBoxes(CausalFilter):
    """Keep the first `k` events of each box of `side` x `side` pixels and `duration`.

    The boxes are fixed in advance. In contrast, the boxes of `NonUniformSample` depend on all events of a window.

    Args:
        k: Events per box (default 1).
        side: Side of a box in pixels (default 4); the first box is at the top left.
        duration: Duration of a box in µs (default 10,000); boxes begin at multiples of it in the recording's clock.

    Returns:
        `Events`. The call takes `Events`, a `Recording` or a list of them; for streams, see `begin`.

    Raises:
        ValueError: A setting isn't a positive integer.

    Example:
        >>> from nvsdata import Events, transforms as T
        >>> events = Events([0, 10, 30, 50], [1, 2, 3, 4], [1, 1, 1, 1], [1, 0, 1, 1], (8, 8))
        >>> T.FirstOfBoxes(k=1, side=4)(events).t.tolist()
        [0, 50]
    """

    k: int = 1
    side: int = 4
    duration: int = 10_000

    def __post_init__(self) -> None:
        whole("k", self.k, 1)
        whole("side", self.side, 1)
        microseconds("duration", self.duration)

    def _masks(self, width: int, height: int) -> Callable[..., np.ndarray]:
        shape = -(-height // self.side), -(-width // self.side)
        box, count = zeros((width, height), shape, np.int64, NEVER), zeros((width, height), shape, np.int64)
        limits = int(self.side), min(int(self.duration), LATEST), int(self.k)
        return lambda t, x, y, p: first_of_boxes(t, x, y, *limits, box, count)


@dataclass(frozen=True)
class RateLimit(CausalFilter):
    """Drop events that exceed a rate in their cell of `side` x `side` pixels; cells below the rate keep all events.

    After a pause, a cell may have `burst` events at once (a leaky bucket, as in computer networks).

    Args:
        rate: Maximum number of events per second in a cell, at most 1e6.
        side: Side of a cell in pixels (default 4); the first cell is at the top left.
        burst: Maximum number of events at once (default 4).

    Returns:
        `Events`. The call takes `Events`, a `Recording` or a list of them; for streams, see `begin`.

    Raises:
        ValueError: `rate` is out of range, or another setting isn't a positive integer.

    Example:
        >>> from nvsdata import Events, transforms as T
        >>> events = Events([0, 10, 20, 1_000_000], [1, 2, 3, 3], [1, 1, 1, 1], [1, 0, 1, 1], (8, 8))
        >>> T.RateLimit(rate=1, burst=2)(events).t.tolist()
        [0, 10, 1000000]
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

    def _masks(self, width: int, height: int) -> Callable[..., np.ndarray]:
        shape = -(-height // self.side), -(-width // self.side)
        due = zeros((width, height), shape, np.int64, NEVER)
        # an integer, so that the same events are kept no matter how the stream is cut
        interval = min(round(1e6 / self.rate), LATEST // (2 * self.burst))
        return lambda t, x, y, p: within_rate(t, x, y, int(self.side), interval, int(self.burst), due)
