"""Transforms that change the times of events."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
import torch

from nvsdata.common.validation import factors, not_negative, probability
from nvsdata.data.events import LATEST, Columns, Events, sort_by_time
from nvsdata.kernels.decode.order import moved
from nvsdata.transforms.apply import decoded, map_sample
from nvsdata.transforms.rng import generator, uniform


@dataclass(frozen=True)
class RelativeTime:
    """Shift times so that `Events.start` becomes 0.

    Returns:
        `Events`. The call takes `Events`, a `Recording` or a list of them, each of which then begins at 0.

    Raises:
        ValueError: The events last 2^62 µs or more.

    Example:
        >>> from nvsdata import Events, transforms as T
        >>> T.RelativeTime()(Events([500, 510], [1, 2], [1, 1], [1, 0])).t.tolist()
        [0, 10]
    """

    deterministic: ClassVar[bool] = True

    def __call__(self, sample: Any) -> Any:
        return map_sample(sample, _relative)


@dataclass(frozen=True)
class RandomTimeScale:
    """Multiply times since the beginning (`Events.start`) by a random factor from [low, high).

    Args:
        low: Smallest factor, above 0 (default 0.8).
        high: Largest factor, at least `low` (default 1.2). Equal bounds make the factor fixed.

    Returns:
        `Events`, with times rounded to µs. The call takes `Events`, a `Recording` or a list of them, which get the same
        factor and are scaled from the beginning of the first one.

    Raises:
        ValueError: A setting is out of range, or times become 2^62 µs or more.

    Example:
        >>> from nvsdata import Events, transforms as T
        >>> T.RandomTimeScale(2, 2)(Events([500, 510], [1, 2], [1, 1], [1, 0])).t.tolist()
        [500, 520]
    """

    low: float = 0.8
    high: float = 1.2

    def __post_init__(self) -> None:
        factors(self.low, self.high)

    def __call__(self, sample: Any) -> Any:
        factor = uniform(self.low, self.high)
        parts, listed = decoded(sample)
        return map_sample(parts, lambda events: _scaled(events, factor, listed[0].start))


@dataclass(frozen=True)
class RandomTimeFlip:
    """Reverse time with probability `p`. ON becomes OFF and OFF becomes ON, as changes of brightness are reversed, too.

    Args:
        p: Probability (default 0.5); 1 always reverses time.

    Returns:
        `Events` with the same time range. The call takes `Events`, a `Recording` or a list of them; the order of a list
        is reversed, too.

    Raises:
        ValueError: `p` isn't a probability.

    Example:
        >>> from nvsdata import Events, transforms as T
        >>> events = T.RandomTimeFlip(p=1)(Events([0, 10, 30], [1, 2, 3], [1, 1, 1], [1, 0, 1]))
        >>> events.t.tolist(), events.x.tolist(), events.p.tolist()
        ([0, 20, 30], [3, 2, 1], [0, 1, 0])
    """

    p: float = 0.5

    def __post_init__(self) -> None:
        probability("p", self.p)

    def __call__(self, sample: Any) -> Any:
        flipped = uniform(0, 1) < self.p
        parts, listed = decoded(sample)
        if not (flipped and listed):
            return parts
        total = listed[0].start + max(part.end for part in listed)
        backwards = [_reversed(part, total) for part in reversed(listed)]
        return backwards if isinstance(parts, list) else backwards[0]


@dataclass(frozen=True)
class TimeJitter:
    """Move each event in time by a normally distributed duration, rounded to µs; events are sorted again.

    Args:
        sigma: Standard deviation in µs (default 100.0).

    Returns:
        `Events`, none of which leaves the time range (`Events.start` to `end`). The call takes `Events`, a `Recording`
        or a list of them.

    Raises:
        ValueError: `sigma` is negative.

    Example:
        >>> import nvsdata
        >>> from nvsdata import transforms as T
        >>> len(T.TimeJitter(1_000)(nvsdata.example())) == len(nvsdata.example())
        True
    """

    sigma: float = 100.0

    def __post_init__(self) -> None:
        not_negative("sigma", self.sigma)

    def __call__(self, sample: Any) -> Any:
        return map_sample(sample, self._jittered)

    def _jittered(self, events: Events) -> Events:
        t, *others = events.columns
        moves = torch.randn(len(events), generator=generator()).numpy()
        times = moved(t, moves, float(self.sigma), events.start, events.end)
        return events.of(sort_by_time(Columns(times, *others)))


def _relative(events: Events) -> Events:
    if events.end - events.start >= LATEST:
        raise ValueError(f"times of {events!r} exceed 2^62 µs if they count from their beginning")
    return _at(events, events.t - events.start, 0, events.end - events.start)


def _scaled(events: Events, factor: float, origin: int) -> Events:
    """Multiply times since `origin` (µs) by a factor."""
    if factor * max(abs(events.end - origin), abs(events.start - origin)) + abs(origin) >= LATEST:
        raise ValueError(f"times of {events!r} exceed 2^62 µs after scaling by {factor}")

    def scaled(t: Any) -> Any:
        return origin + np.rint((t - origin) * factor).astype(np.int64)

    return _at(events, scaled(events.t), int(scaled(np.array(events.start))), int(scaled(np.array(events.end))))


def _reversed(events: Events, total: int) -> Events:
    """Reverse time, so that t becomes `total` - t, and swap polarities."""
    t, x, y, p = events.columns
    columns = Columns((total - t)[::-1].copy(), x[::-1].copy(), y[::-1].copy(), 1 - p[::-1])
    return Events.trusted(columns, events.sensor_size, total - events.end, total - events.start)


def _at(events: Events, t: np.ndarray, start: int, end: int) -> Events:
    _, *others = events.columns
    return Events.trusted(Columns(t, *others), events.sensor_size, start, end)
