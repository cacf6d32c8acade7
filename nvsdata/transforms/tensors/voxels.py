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
    """Sum polarity ±1 in B bins of time, divided between the two nearest bins (Zhu et al. 2019, equations 1 and 2).

    Time is scaled so that the first event is at bin 0 and the last one at bin B - 1: t* = (B - 1) (t - t_1) /
    (t_N - t_1), and an event adds p max(0, 1 - |b - t*|) to bin b. If all events are at one time, they are in bin 0.
    tonic scales time to B, and loses the parts of events that are beyond B - 1.

    Args:
        bins: Number of bins B.
        interpolation: "linear" (default), or "nearest": an event is added to the nearest bin, and to the later one of
            two equally near bins.

    Returns:
        float32 [B, H, W]. The call takes `Events` or a `Recording`.

    Raises:
        ValueError: A setting is out of range.

    Example:
        >>> from nvsdata import Events, transforms as T
        >>> T.VoxelGrid(2)(Events([0, 5, 10], [0, 0, 1], [0, 0, 0], [1, 1, 0], (2, 1))).tolist()
        [[[1.5, 0.0]], [[0.5, -1.0]]]
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
