"""Voxel grids of events."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal, get_args

import torch

from nvsdata.common.memory import zeros
from nvsdata.common.validation import whole
from nvsdata.data.events import Events
from nvsdata.data.recording import Recording, events_inside
from nvsdata.kernels.represent.frames import spread

Interpolation = Literal["linear", "nearest"]


@dataclass(frozen=True)
class VoxelGrid:
    """Polarity ±1 in B bins of time, divided between the two nearest (Zhu et al. 2019, eq. 1 and 2): [B, H, W].

    Time is scaled so that the first event lies at bin 0 and the last one at bin B - 1: t* = (B - 1) (t - t_1) /
    (t_N - t_1), and an event adds p max(0, 1 - |b - t*|) to bin b. tonic scales to B, and loses
    what lies beyond B - 1.

    - `bins`: B
    - `interpolation`: "linear" (default); with "nearest" an event goes to the nearest bin, of two the later one

    Takes `Events` or a `Recording`, gives float32. If all events are at one time, they are in bin 0. ValueError for
    settings out of range.
    """

    bins: int
    interpolation: Interpolation = "linear"
    deterministic: ClassVar[bool] = True

    def __post_init__(self) -> None:
        whole("bins", self.bins, 1)
        if self.interpolation not in get_args(Interpolation):
            raise ValueError(f"interpolation must be one of {get_args(Interpolation)}, not {self.interpolation!r}")

    def __call__(self, sample: Events | Recording) -> torch.Tensor:
        events = events_inside(sample)
        width, height = events.sensor_size
        out = zeros(events.sensor_size, (int(self.bins), height, width))
        if len(events):
            spread(*events.columns, self.interpolation == "linear", out)
        return torch.from_numpy(out)


def voxel_grid(sample: Events | Recording, bins: int, interpolation: Interpolation = "linear") -> torch.Tensor:
    """Polarity in bins of time; see `VoxelGrid`."""
    return VoxelGrid(bins, interpolation)(sample)
