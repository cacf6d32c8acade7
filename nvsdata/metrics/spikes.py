"""Events as spikes of frames: polarity summed at each position (P_sigma of section 3.3)."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from nvsdata.events import Events
from nvsdata.kernels.distances import spikes as gather
from nvsdata.kernels.distances import sum_polarity

MICROSECONDS = 1_000_000


class Spikes(NamedTuple):
    """Spikes of one frame in raster order: `x`, `y` int64 pixels, `total` int64 the summed polarity, never 0."""

    x: np.ndarray
    y: np.ndarray
    total: np.ndarray

    def __len__(self) -> int:  # of a NamedTuple: the number of spikes, not of columns
        return int(self.x.size)


def frame_edges(duration: int, fps: float | None) -> np.ndarray:
    """µs at which frames begin and end that cover times 0 to `duration`, int64 [frames + 1]."""
    if fps is None:
        return np.array([0, duration + 1])
    count = int(duration * fps / MICROSECONDS) + 1
    edges = np.round(np.arange(count + 2) * MICROSECONDS / fps).astype(np.int64)
    return edges[: np.searchsorted(edges, duration, "right") + 1]


def spikes_of_frames(events: Events, origin: int, edges: np.ndarray) -> Iterator[Spikes]:
    """Spikes of the frames between `edges`, µs since `origin`."""
    sums = np.zeros(events.sensor_size[::-1], np.int32)
    bounds = np.searchsorted(events.t, origin + edges)
    touched = np.empty(int(np.diff(bounds).max(initial=0)), np.int64)
    for lo, hi in pairwise(bounds):
        count = sum_polarity(events.x[lo:hi], events.y[lo:hi], events.p[lo:hi], sums, touched)
        yield Spikes(*gather(sums, touched, count))
