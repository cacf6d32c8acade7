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
    """What a cascade of delayed filters puts out: float32 [2 filters, H, W], 0 or 1 (Amir et al. 2017; thesis 2.1.2).

    Filter k = 1, 2, ... sees the events k ticks late. Its neurons, one per pixel and polarity, are set to 1 by an
    event, leak at a constant rate to 0 within `decay` ticks, and put out an event with this probability: more of them
    the less time has passed. The result is that of the tick after the end of the events' time (`Events.end`), the least
    delayed filter first, of each ON first. Ticks begin at `Events.start`.

    - `filters`: K (default 6)
    - `tick`: in µs (default 1,000)
    - `decay`: in ticks, at least 1 (default 1.0: nothing is drawn, each filter shows the events of its tick)

    Takes `Events` or a `Recording`. ValueError for settings out of range.
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
        # what happened before is forgotten
        first = events.start + tick * int(max(now - filters - np.ceil(self.decay), 0))
        recent = events.columns.take(slice(int(np.searchsorted(events.t, first)), None))
        latest_ticks(*recent, events.start, tick, now, float(self.decay), out)
        potential = torch.from_numpy(out).flatten(0, 1)
        if self.decay == 1:
            return potential
        return (torch.rand(potential.shape, generator=generator()) < potential).float()


def filter_cascade(
    sample: Events | Recording, filters: int = 6, tick: int = 1_000, *, decay: float = 1.0
) -> torch.Tensor:
    """What a cascade of delayed filters puts out; see `FilterCascade`."""
    return FilterCascade(filters, tick, decay)(sample)
