"""Filters of noise: background activity and hot pixels."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from nvsdata.common.memory import allocated, zeros
from nvsdata.common.validation import microseconds, positive
from nvsdata.data.events import LATEST, Events, check_inside
from nvsdata.kernels.represent import filters as kernel
from nvsdata.transforms.apply import map_sample


@dataclass(frozen=True)
class BackgroundActivity:
    """Drop isolated events: those without an event at one of the eight neighboring pixels in the `window` before them.

    The filter is that of Delbruck 2008. Of events at the same time, those that come first count as earlier. tonic's
    `Denoise` uses four neighboring pixels.

    Args:
        window: Duration in µs (default 10,000).

    Returns:
        `Events`. The call takes `Events`, a `Recording` or a list of them.

    Raises:
        ValueError: `window` isn't a positive integer.

    Example:
        >>> from nvsdata import Events, transforms as T
        >>> events = Events([0, 10, 20], [1, 2, 7], [1, 1, 7], [1, 0, 1], (8, 8))
        >>> T.BackgroundActivity()(events).t.tolist()
        [10]
    """

    window: int = 10_000
    deterministic: ClassVar[bool] = True

    def __post_init__(self) -> None:
        microseconds("window", self.window)

    def __call__(self, sample: Any) -> Any:
        return map_sample(sample, self._filtered)

    def _filtered(self, events: Events) -> Events:
        t, x, y, _ = check_inside(events).columns
        shape = events.sensor_size[1] + 2, events.sensor_size[0] + 2
        settings = shape, min(int(self.window), LATEST)
        kept = allocated(events.sensor_size, shape, np.int64, lambda: kernel.supported_by_neighbors(t, x, y, *settings))
        return events.of(events.columns.take(kept))


@dataclass(frozen=True)
class HotPixels:
    """Drop all events of pixels with more than `rate` events per second on average.

    The average is taken over the time of the events (`Events.start` to `end`), at least 1 µs.

    Args:
        rate: Maximum rate in events per second (default 1000).

    Returns:
        `Events`. The call takes `Events`, a `Recording` or a list of them.

    Raises:
        ValueError: `rate` isn't positive.

    Example:
        >>> from nvsdata import Events, transforms as T
        >>> events = Events([0, 10, 20, 1000], [1, 1, 1, 7], [1, 1, 1, 7], [1, 0, 1, 1], (8, 8))
        >>> T.HotPixels()(events).t.tolist()
        [1000]
    """

    rate: float = 1000
    deterministic: ClassVar[bool] = True

    def __post_init__(self) -> None:
        positive("rate", self.rate)

    def __call__(self, sample: Any) -> Any:
        return map_sample(sample, self._filtered)

    def _filtered(self, events: Events) -> Events:
        counts = zeros(check_inside(events).sensor_size, events.sensor_size[::-1], np.int64)
        kernel.count_into(events.x, events.y, counts)
        most = self.rate * max(events.end - events.start, 1) / 1e6
        return events.of(events.columns.take(counts[events.y, events.x] <= most))
