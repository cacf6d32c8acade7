"""Subsampling: non-uniform grid sampling, consecutive events, and random dropping."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import torch

from nvsdata.common.validation import not_negative, probability, whole
from nvsdata.data.events import Events
from nvsdata.data.recording import Recording, as_events
from nvsdata.kernels.represent.filters import in_rectangle
from nvsdata.kernels.represent.sample import nonuniform_sample
from nvsdata.transforms.apply import decoded, map_sample
from nvsdata.transforms.rng import generator, randint, uniform, window_start

# Weight of a squared time in µs² relative to a squared distance in pixels² (beta in the thesis, equation 4.2). The
# author's code scales time by 0.5e-5 per µs and then squares it: in his graphs 30 ms are 0.15 pixels. Read literally,
# the thesis says that beta itself is 0.5e-5.
TIME_SCALE = 0.5e-5
BETA = TIME_SCALE**2
LITERAL_BETA = 0.5e-5


@dataclass(frozen=True)
class NonUniformSample:
    """Keep one random event of each box of at most `k` events (non-uniform grid sampling; thesis, section 4.2.1).

    The space-time box around the events is split at the median along its widest side, and so are its parts, until no
    box has more than `k` events. Widths are weighted like distances in `RadiusGraph`.

    Args:
        k: Maximum number of events in a box (default 8); 1 keeps all events.
        alpha: Weight of squared pixels (default 1.0).
        beta: Weight of squared µs (default (0.5e-5)²; see `RadiusGraph`).

    Returns:
        `Events`. The call takes `Events` or a `Recording`.

    Raises:
        ValueError: A setting is out of range.

    Example:
        >>> import nvsdata
        >>> from nvsdata import transforms as T
        >>> events = nvsdata.example()
        >>> 1 / 8 <= len(T.NonUniformSample(8)(events)) / len(events) <= 1 / 4
        True
    """

    k: int = 8
    alpha: float = 1.0
    beta: float = BETA

    def __post_init__(self) -> None:
        whole("k", self.k, 1)
        not_negative("alpha", self.alpha)
        not_negative("beta", self.beta)

    def __call__(self, sample: Events | Recording) -> Events:
        events = as_events(sample)
        if self.k == 1:
            return events
        # the indices are sorted, so the events are sorted, too
        chosen = nonuniform_sample(
            events.t, events.x, events.y, self.k, math.sqrt(self.alpha), math.sqrt(self.beta), randint(2**62)
        )
        return events.of(events.columns.take(chosen))


@dataclass(frozen=True)
class RandomRun:
    """Keep `count` consecutive events from a random one on; keep all if there are at most `count`.

    Args:
        count: Number of events (default 10,000).

    Returns:
        `Events`. The call takes `Events` or a `Recording`.

    Raises:
        ValueError: `count` isn't a positive integer.

    Example:
        >>> import nvsdata
        >>> from nvsdata import transforms as T
        >>> len(T.RandomRun(5_000)(nvsdata.example()))
        5000
    """

    count: int = 10_000

    def __post_init__(self) -> None:
        whole("count", self.count, 1)

    def __call__(self, sample: Events | Recording) -> Events:
        events, count = as_events(sample), int(self.count)
        first = window_start(max(len(events) - count, 0) + 1)
        return events if len(events) <= count else events[first : first + count]


@dataclass(frozen=True)
class DropEvents:
    """Drop each event with the same probability, which is sampled from [0, `most`) for each sample.

    Args:
        most: Upper bound of the probability (default 0.3).

    Returns:
        `Events`. The call takes `Events`, a `Recording` or a list of them, which get the same probability.

    Raises:
        ValueError: `most` isn't a probability.

    Example:
        >>> import nvsdata
        >>> from nvsdata import transforms as T
        >>> len(T.DropEvents(0.3)(nvsdata.example())) <= len(nvsdata.example())
        True
    """

    most: float = 0.3

    def __post_init__(self) -> None:
        probability("most", self.most)

    def __call__(self, sample: Any) -> Any:
        fraction = uniform(0, self.most)
        return map_sample(
            sample, lambda events: events[(torch.rand(len(events), generator=generator()) >= fraction).numpy()]
        )


@dataclass(frozen=True)
class DropByTime:
    """Drop all events of a random interval.

    Args:
        fraction: Duration of the interval as a fraction of the duration of the events, 0 to 1 (default 0.2).

    Returns:
        `Events`. The call takes `Events`, a `Recording` or a list of them, which get the same interval.

    Raises:
        ValueError: `fraction` is out of range.

    Example:
        >>> import nvsdata
        >>> from nvsdata import transforms as T
        >>> len(T.DropByTime(0.5)(nvsdata.example())) < len(nvsdata.example())
        True
    """

    fraction: float = 0.2

    def __post_init__(self) -> None:
        probability("fraction", self.fraction)

    def __call__(self, sample: Any) -> Any:
        parts, listed = decoded(sample)
        if not listed:
            return parts
        start = listed[0].start
        moments = max(part.end for part in listed) - start + 1
        length = min(round(self.fraction * moments), moments)
        begin = start + randint(moments - length + 1)
        return map_sample(
            parts, lambda events: events.of(events.columns.take((events.t < begin) | (events.t >= begin + length)))
        )


@dataclass(frozen=True)
class DropByArea:
    """Drop all events of a random rectangle, which has the aspect ratio of the sensor.

    Args:
        fraction: Area of the rectangle as a fraction of the area of the sensor, 0 to 1 (default 0.2).

    Returns:
        `Events`. The call takes `Events`, a `Recording` or a list of them, all of one sensor, which get the same
        rectangle.

    Raises:
        ValueError: `fraction` is out of range.

    Example:
        >>> import nvsdata
        >>> from nvsdata import transforms as T
        >>> len(T.DropByArea(1.0)(nvsdata.example()))
        0
    """

    fraction: float = 0.2

    def __post_init__(self) -> None:
        probability("fraction", self.fraction)

    def __call__(self, sample: Any) -> Any:
        parts, listed = decoded(sample)
        if not listed:
            return parts
        sensor = listed[0].sensor_size
        size = [round(side * math.sqrt(self.fraction)) for side in sensor]
        x, y = (randint(side - cut + 1) for side, cut in zip(sensor, size, strict=True))
        return map_sample(
            parts, lambda events: events.of(events.columns.take(~in_rectangle(events.x, events.y, x, y, *size)))
        )
