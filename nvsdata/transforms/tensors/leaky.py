"""Frames whose values decay at a constant rate."""

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
    """Add each event to its pixel, and let all pixels decay at a constant rate, not below 0 (Cannici et al. 2018).

    ON and OFF events count alike. For streams, see `state`.

    Args:
        leak: Decrease of the values per µs (default 1 / 50,000).
        increment: Value that an event adds (default 1.0).

    Returns:
        float32 [1, H, W], the values at the end of the events' time (`Events.end`). The call takes `Events` or a
        `Recording`.

    Raises:
        ValueError: A setting is out of range.

    Example:
        >>> from nvsdata import Events, transforms as T
        >>> T.LeakyFrame(leak=0.25)(Events([0, 2], [0, 1], [0, 0], [1, 1], (2, 1))).tolist()
        [[[0.5, 1.0]]]
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
        """Return a state for a stream: `update(events)` takes the next events, `tensor()` returns [1, H, W]."""
        return LeakyState(sensor_size, self.leak, self.increment)
