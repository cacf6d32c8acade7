"""Frames that leak."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import torch

from nvsdata.common.validation import not_negative, positive
from nvsdata.data.events import Events
from nvsdata.data.recording import Recording, as_events
from nvsdata.transforms.tensors.states import LeakyState


@dataclass(frozen=True)
class LeakyFrame:
    """Each event adds to its pixel, and all pixels fall at a constant rate, not below 0: float32 [1, H, W].

    The value at the end of the events' time (`Events.end`), without regard to polarity (Cannici et al. 2018).

    - `leak`: by how much values fall per µs (default 1 / 50,000)
    - `increment`: what an event adds (default 1.0)

    Takes `Events` or a `Recording`. ValueError for settings out of range.
    """

    leak: float = 1 / 50_000
    increment: float = 1.0
    deterministic: ClassVar[bool] = True

    def __post_init__(self) -> None:
        not_negative("leak", self.leak)
        positive("increment", self.increment)

    def __call__(self, sample: Events | Recording) -> torch.Tensor:
        events = as_events(sample)
        state = self.state(events.sensor_size)
        state.update(events)
        return state.tensor()

    def state(self, sensor_size: tuple[int, int]) -> LeakyState:
        """For events that come piece by piece: `state.update(events)`, `state.tensor()`."""
        return LeakyState(sensor_size, self.leak, self.increment)


def leaky_frame(sample: Events | Recording, leak: float = 1 / 50_000, increment: float = 1.0) -> torch.Tensor:
    """A frame of values that leak; see `LeakyFrame`."""
    return LeakyFrame(leak, increment)(sample)
