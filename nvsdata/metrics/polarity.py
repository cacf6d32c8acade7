"""Events as spikes of frames: polarity summed at each position (P_sigma of section 3.3)."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from nvsdata.data.events import Events, check_inside
from nvsdata.data.frame_edges import frame_bounds
from nvsdata.kernels.metrics.distances import spikes as gather
from nvsdata.kernels.metrics.distances import sum_polarity


class Spikes(NamedTuple):
    """Spikes of one frame in raster order.

    - `x`, `y`: int64 [spikes], pixels
    - `total`: int64 [spikes], summed polarity, never 0
    """

    x: np.ndarray
    y: np.ndarray
    total: np.ndarray

    def __len__(self) -> int:  # number of spikes; a NamedTuple's own would count the columns
        return int(self.x.size)


def spikes_of_frames(events: Events, origin: int, edges: np.ndarray) -> Iterator[Spikes]:
    """Spikes of each frame; `edges` are its bounds in µs since `origin`."""
    sums = np.zeros(check_inside(events).sensor_size[::-1], np.int32)
    bounds = frame_bounds(events, origin, edges)
    touched = np.empty(int(np.diff(bounds).max(initial=0)), np.int64)
    for lo, hi in pairwise(bounds):
        count = sum_polarity(events.x[lo:hi], events.y[lo:hi], events.p[lo:hi], sums, touched)
        yield Spikes(*gather(sums, touched, count))
