"""Queues of pixels' latest bins of time with events (temporal active focus)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import torch

from nvsdata.common.validation import microseconds, whole
from nvsdata.data.events import LATEST, Events
from nvsdata.data.recording import Recording, as_events
from nvsdata.transforms.tensors.states import FocusState


@dataclass(frozen=True)
class TAF:
    """How long ago pixels' latest `depth` bins of time with events were: float32 [2 depth, H, W] (Liu et al. 2023).

    Time is cut into bins of `duration` from the beginning of the events' time on. Of each pixel and polarity, the mean
    times of the latest bins that have events are kept; their ages at the end of the events' time (`Events.end`), in
    bins, are shown as max(0, 1 - log(1 + age) / 8.7), and 0 where there were fewer. The latest bin comes last, and of
    each OFF before ON, as in the authors' code.

    - `depth`: number of bins kept (default 8)
    - `duration`: of a bin in µs (default 10,000)

    Takes `Events` or a `Recording`. ValueError for settings that aren't positive whole numbers.
    """

    depth: int = 8
    duration: int = 10_000
    deterministic: ClassVar[bool] = True

    def __post_init__(self) -> None:
        whole("depth", self.depth, 1)
        microseconds("duration", self.duration)

    def __call__(self, sample: Events | Recording) -> torch.Tensor:
        events = as_events(sample)
        state = self.state(events.sensor_size)
        state.update(events)
        return state.tensor()

    def state(self, sensor_size: tuple[int, int]) -> FocusState:
        """For events that come piece by piece: `state.update(events)`, `state.tensor()`; bins begin at the first."""
        return FocusState(sensor_size, int(self.depth), min(int(self.duration), LATEST))


def taf(sample: Events | Recording, depth: int = 8, duration: int = 10_000) -> torch.Tensor:
    """How long ago pixels' latest bins of time with events were; see `TAF`."""
    return TAF(depth, duration)(sample)
