"""Descriptors of events on a log-polar grid (DART)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import ClassVar

import numpy as np
import torch

from nvsdata.common.memory import zeros
from nvsdata.common.validation import positive, whole
from nvsdata.data.events import Events
from nvsdata.data.recording import Recording, events_inside
from nvsdata.kernels.represent.patches import around_events


@dataclass(frozen=True)
class DART:
    """Count recent events around each event on a log-polar grid (DART; Ramesh et al. 2019; thesis, section 2.1.1).

    The `queue` latest events up to the event, itself included, are counted. Rings are at equal distances in the
    logarithm of the radius from `nearest` to `furthest`, wedges at equal angles from the x axis on, towards y. An event
    is divided between the two nearest rings and the two nearest wedges; events nearer than `nearest` are on the first
    ring. A descriptor sums to 1, so fast motion and strong contrast, which cause more events, don't change it. Polarity
    is ignored. The default sizes are ours, because those in the paper depend on the task.

    Args:
        rings: Number of rings (default 7).
        wedges: Number of wedges (default 12).
        nearest: Radius of the first ring in pixels (default 1.0).
        furthest: Radius of the last ring in pixels (default 10.0).
        queue: Number of latest events that are counted (default 2,000).

    Returns:
        float32 [N, rings wedges] for N events. The call takes `Events` or a `Recording`.

    Raises:
        ValueError: A setting is out of range.

    Example:
        >>> from nvsdata import Events, transforms as T
        >>> T.DART(rings=3, wedges=4)(Events([0, 5, 10], [0, 3, 5], [0, 1, 0], [1, 1, 0], (8, 8))).shape
        torch.Size([3, 12])
    """

    rings: int = 7
    wedges: int = 12
    nearest: float = 1.0
    furthest: float = 10.0
    queue: int = 2_000
    deterministic: ClassVar[bool] = True

    def __post_init__(self) -> None:
        whole("rings", self.rings, 2)
        whole("wedges", self.wedges, 1)
        whole("queue", self.queue, 1)
        positive("nearest", self.nearest)
        positive("furthest", self.furthest)
        if self.furthest <= self.nearest:
            raise ValueError(f"furthest must be more than nearest, not {self.furthest} <= {self.nearest}")

    def __call__(self, sample: Events | Recording) -> torch.Tensor:
        events = events_inside(sample)
        width, height = events.sensor_size
        dx, dy, weights = _weights(int(self.rings), int(self.wedges), float(self.nearest), float(self.furthest))
        margin = 2 * int(dx.max())
        out = np.zeros((len(events), weights.shape[1]), np.float32)
        count = zeros(events.sensor_size, (height + margin, width + margin), np.int32)
        around_events(events.x, events.y, min(int(self.queue), len(events) + 1), dx, dy, weights, count, out)
        return torch.from_numpy(out)


@cache
def _weights(rings: int, wedges: int, nearest: float, furthest: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the offsets dx and dy from an event in pixels, and the weight of each offset in each log-polar bin."""
    reach = int(furthest)
    dy, dx = (axis.ravel() for axis in np.mgrid[-reach : reach + 1, -reach : reach + 1])
    radius = np.hypot(dx, dy)
    inside = radius <= furthest
    dx, dy, radius = dx[inside], dy[inside], radius[inside]
    logarithm = np.log(np.maximum(radius, nearest) / nearest) / np.log(furthest / nearest)
    ring, wedge = logarithm * (rings - 1), np.arctan2(dy, dx) / (2 * np.pi) * wedges
    weights = np.zeros((dx.size, rings, wedges), np.float32)
    low, first = np.minimum(np.floor(ring).astype(int), rings - 2), np.floor(wedge).astype(int)
    every = np.arange(dx.size)
    for further in (0, 1):
        for after in (0, 1):
            weight = np.abs(1 - further - (ring - low)) * np.abs(1 - after - (wedge - first))
            np.add.at(weights, (every, low + further, (first + after) % wedges), weight)
    return dx, dy, weights.reshape(dx.size, -1)
