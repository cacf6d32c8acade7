"""Noise: random shifts of events in space, and additional events."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import torch

from nvsdata.common.validation import not_negative, whole
from nvsdata.data.events import Columns, Events, sort_by_time
from nvsdata.transforms.apply import map_sample
from nvsdata.transforms.rng import generator


@dataclass(frozen=True)
class SpatialJitter:
    """Move each event along both axes by normally distributed distances, rounded to pixels.

    Events that leave the sensor are dropped.

    Args:
        sigma: Standard deviation in pixels (default 1.0).

    Returns:
        `Events`. The call takes `Events`, a `Recording` or a list of them.

    Raises:
        ValueError: `sigma` is negative.

    Example:
        >>> import nvsdata
        >>> from nvsdata import transforms as T
        >>> len(T.SpatialJitter(2.0)(nvsdata.example())) <= len(nvsdata.example())
        True
    """

    sigma: float = 1.0

    def __post_init__(self) -> None:
        not_negative("sigma", self.sigma)

    def __call__(self, sample: Any) -> Any:
        return map_sample(sample, self._jittered)

    def _jittered(self, events: Events) -> Events:
        moves = torch.randn(2, len(events), generator=generator()).numpy() * np.float32(min(self.sigma, 1e9))
        width, height = events.sensor_size
        x, y = events.x + np.rint(moves[0]), events.y + np.rint(moves[1])
        inside = (x >= 0) & (x < width) & (y >= 0) & (y < height)
        x, y = x[inside].astype(np.int16), y[inside].astype(np.int16)
        return events.of(Columns(events.t[inside], x, y, events.p[inside]))


@dataclass(frozen=True)
class UniformNoise:
    """Add events at random pixels and times, of random polarity.

    Times are within the time range of the events (`Events.start` to `end`). At equal times the new events come last.

    Args:
        count: Number of events to add (default 100), to each part of a list.

    Returns:
        `Events`. The call takes `Events`, a `Recording` or a list of them.

    Raises:
        ValueError: `count` isn't an integer, or is negative.

    Example:
        >>> import nvsdata
        >>> from nvsdata import transforms as T
        >>> len(T.UniformNoise(100)(nvsdata.example())) - len(nvsdata.example())
        100
    """

    count: int = 100

    def __post_init__(self) -> None:
        whole("count", self.count)

    def __call__(self, sample: Any) -> Any:
        return map_sample(sample, self._added)

    def _added(self, events: Events) -> Events:
        high = (events.end - events.start + 1, *events.sensor_size, 2)
        new = [torch.randint(bound, (int(self.count),), generator=generator()).numpy() for bound in high]
        new[0] += events.start
        joined = [np.concatenate((old, more.astype(old.dtype))) for old, more in zip(events.columns, new, strict=True)]
        return events.of(sort_by_time(Columns(*joined)))
