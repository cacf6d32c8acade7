"""The four-channel image of EV-FlowNet."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import torch

from nvsdata.common.memory import zeros
from nvsdata.data.events import Events
from nvsdata.data.recording import Recording, events_inside
from nvsdata.kernels.represent.latest import counts_and_times


@dataclass(frozen=True)
class FourChannels:
    """Numbers of ON and of OFF events, and times of the last ON and OFF event: float32 [4, H, W] (Zhu et al. 2018).

    Times are shares of the events' time: 0 at `Events.start`, 1 at `Events.end`; 0 where there was no event, too.
    Takes `Events` or a `Recording`.
    """

    deterministic: ClassVar[bool] = True

    def __call__(self, sample: Events | Recording) -> torch.Tensor:
        return four_channels(sample)


def four_channels(sample: Events | Recording) -> torch.Tensor:
    """Counts and latest times; see `FourChannels`."""
    events = events_inside(sample)
    width, height = events.sensor_size
    out = zeros(events.sensor_size, (4, height, width))
    counts_and_times(*events.columns, events.start, max(events.end - events.start, 1), out)
    return torch.from_numpy(out)
