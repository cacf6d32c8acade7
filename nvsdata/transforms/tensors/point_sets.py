"""Events as points, for PointNet and LSTMs (thesis, Table 5.1)."""

from __future__ import annotations

from dataclasses import dataclass

import torch

from nvsdata.common.validation import whole
from nvsdata.data.events import Events
from nvsdata.data.recording import Recording, as_events
from nvsdata.transforms.rng import generator


@dataclass(frozen=True)
class Points:
    """Sample events at random, as points in order of time.

    No event is sampled twice unless there are fewer than `count` events.

    Args:
        count: Number of points (default 1024).

    Returns:
        float32 [count, 4]: x, y and t in [0, 1] and polarity ±1. x and y are relative to the sensor's size; t is 0 at
        the first event and 1 at the last. Without events, all values are 0. The call takes `Events` or a
        `Recording`.

    Raises:
        ValueError: `count` isn't a positive integer.

    Example:
        >>> from nvsdata import Events, transforms as T
        >>> T.Points(2)(Events([0, 10], [0, 8], [4, 2], [1, 0], (9, 9))).tolist()
        [[0.0, 0.5, 0.0, 1.0], [1.0, 0.25, 1.0, -1.0]]
    """

    count: int = 1024

    def __post_init__(self) -> None:
        whole("count", self.count, 1)

    def __call__(self, sample: Events | Recording) -> torch.Tensor:
        events, count = as_events(sample), int(self.count)
        if not len(events):
            return torch.zeros(count, 4)
        if len(events) >= count:
            index = torch.randperm(len(events), generator=generator())[:count].sort().values
        else:
            index = torch.randint(len(events), (count,), generator=generator()).sort().values
        width, height = events.sensor_size
        t = torch.from_numpy(events.t)
        # differences are taken in integers: absolute times don't fit float32
        since = (t[index] - t[0]).double() / max(int(t[-1] - t[0]), 1)
        x, y, p = (torch.from_numpy(column)[index].double() for column in (events.x, events.y, events.p))
        return torch.stack((x / max(width - 1, 1), y / max(height - 1, 1), since, 2 * p - 1), 1).float()
