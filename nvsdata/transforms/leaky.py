"""Frames that leak."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import torch

from nvsdata.common.validation import not_negative, positive
from nvsdata.data.events import Events
from nvsdata.data.recording import Recording, as_events
from nvsdata.kernels.latest import leaked


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
        size = events.sensor_size[::-1]
        out, since = np.empty((1, *size), np.float32), np.full(size, events.start)
        t, x, y, _ = events.columns
        leaked(t, x, y, events.end, float(self.increment), float(self.leak), np.zeros(size), since, out)
        return torch.from_numpy(out)


def leaky_frame(sample: Events | Recording, leak: float = 1 / 50_000, increment: float = 1.0) -> torch.Tensor:
    """A frame of values that leak; see `LeakyFrame`."""
    return LeakyFrame(leak, increment)(sample)
