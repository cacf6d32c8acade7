"""Cascades of delayed temporal filters."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch

from nvsdata.common.memory import zeros
from nvsdata.common.validation import at_least, microseconds, whole
from nvsdata.data.events import LATEST, Events
from nvsdata.data.recording import Recording, events_inside
from nvsdata.kernels.represent.latest import latest_ticks
from nvsdata.transforms.rng import generator


@dataclass(frozen=True)
class FilterCascade:
    """Compute the output of a cascade of delayed filters (Amir et al. 2017; thesis, section 2.1.2).

    Filter k = 1, 2, ... receives the events k ticks late. It has one neuron per pixel and polarity. An event sets the
    neuron to 1; then its value decays at a constant rate to 0 within `decay` ticks. At each tick, the value is the
    probability of an output event. The result is the output at the tick after the one that contains `Events.end`.
    The first tick begins at `Events.start`.

    Args:
        filters: Number of filters, K in the paper (default 6).
        tick: Duration of a tick in µs (default 1,000).
        decay: Number of ticks, at least 1 (default 1.0: there is no randomness, and each filter outputs the events of
            its tick).

    Returns:
        float32 [2 filters, H, W], 0 or 1. The least delayed filter comes first; within a filter, ON comes first. The
        call takes `Events` or a `Recording`.

    Raises:
        ValueError: A setting is out of range.

    Example:
        >>> from nvsdata import Events, transforms as T
        >>> T.FilterCascade(filters=2, tick=5)(Events([0, 5, 10], [0, 0, 1], [0, 0, 0], [1, 1, 0], (2, 1))).tolist()
        [[[0.0, 0.0]], [[0.0, 1.0]], [[1.0, 0.0]], [[0.0, 0.0]]]
    """

    filters: int = 6
    tick: int = 1_000
    decay: float = 1.0

    def __post_init__(self) -> None:
        whole("filters", self.filters, 1)
        microseconds("tick", self.tick)
        at_least("decay", self.decay, 1)

    def __call__(self, sample: Events | Recording) -> torch.Tensor:
        events, filters, tick = events_inside(sample), int(self.filters), min(int(self.tick), LATEST)
        out = zeros(events.sensor_size, (filters, 2, *events.sensor_size[::-1]))
        now = (events.end - events.start) // tick + 1
        # earlier events have no effect any more
        first = events.start + tick * int(max(now - filters - np.ceil(self.decay), 0))
        recent = events.columns.take(slice(int(np.searchsorted(events.t, first)), None))
        latest_ticks(*recent, events.start, tick, now, float(self.decay), out)
        potential = torch.from_numpy(out).flatten(0, 1)
        if self.decay == 1:
            return potential
        return (torch.rand(potential.shape, generator=generator()) < potential).float()
