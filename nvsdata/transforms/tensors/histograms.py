"""Stacks of histograms: of equal parts of time, and of ever longer ones."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import torch

from nvsdata.common.memory import zeros
from nvsdata.common.validation import whole
from nvsdata.data.events import Events
from nvsdata.data.frame_edges import check_count, fraction_bounds
from nvsdata.data.recording import Recording, events_inside
from nvsdata.kernels.represent.frames import counted, counted_by_polarity


@dataclass(frozen=True)
class StackedHistogram:
    """Numbers of events in equal parts of time: [2 bins, H, W], all bins of OFF, then all of ON (RVT, Gehrig 2023).

    The bins cover the time from the first event to the last, half open, the last one closed.

    - `bins`: number of parts (default 10)
    - `most`: larger numbers count as this (default 10)

    Takes `Events` or a `Recording`, gives float32 (RVT stores uint8). ValueError for settings that aren't positive
    whole numbers.
    """

    bins: int = 10
    most: int = 10
    deterministic: ClassVar[bool] = True

    def __post_init__(self) -> None:
        whole("bins", self.bins, 1)
        whole("most", self.most, 1)

    def __call__(self, sample: Events | Recording) -> torch.Tensor:
        events, bins = events_inside(sample), int(self.bins)
        check_count(bins)
        out = zeros(events.sensor_size, (2, bins, *events.sensor_size[::-1]))
        if len(events):
            bounds = fraction_bounds(events, int(events.t[0]), int(events.t[-1]), [(n, bins) for n in range(bins)])
            counted_by_polarity(events.x, events.y, events.p, bounds, out)
        return torch.from_numpy(np.minimum(out, np.float32(self.most), out=out)).flatten(0, 1)


@dataclass(frozen=True)
class MixedDensityStack:
    """Summed polarity of ever longer parts of time: [bins, H, W] (Nam et al. 2022, as RVT has it).

    Channel i has the events before 2^(i + 1 - bins) of the time from the first event to the last; the last channel has
    all events.

    - `bins`: number of channels (default 10)
    - `most`: sums are cut off at this, either way (default None: not at all)

    Takes `Events` or a `Recording`, gives float32 (RVT stores int8). ValueError for settings that aren't positive whole
    numbers, and more than 60 bins.
    """

    bins: int = 10
    most: int | None = None
    deterministic: ClassVar[bool] = True

    def __post_init__(self) -> None:
        whole("bins", self.bins, 1)
        if self.bins > 60:
            raise ValueError(f"bins must be at most 60, not {self.bins}: a part of 2^-60 holds no µs")
        if self.most is not None:
            whole("most", self.most, 1)

    def __call__(self, sample: Events | Recording) -> torch.Tensor:
        events, bins = events_inside(sample), int(self.bins)
        out = zeros(events.sensor_size, (bins, 1, *events.sensor_size[::-1]))
        if len(events):
            shares = [(0, 1), *((1, 1 << (bins - b)) for b in range(1, bins))]
            bounds = fraction_bounds(events, int(events.t[0]), int(events.t[-1]), shares)
            counted(events.x, events.y, events.p, bounds, out)
        summed = torch.from_numpy(out[:, 0]).cumsum_(0)
        return summed if self.most is None else summed.clamp_(-self.most, self.most)


def stacked_histogram(sample: Events | Recording, bins: int = 10, most: int = 10) -> torch.Tensor:
    """Numbers of events in equal parts of time; see `StackedHistogram`."""
    return StackedHistogram(bins, most)(sample)


def mixed_density_stack(sample: Events | Recording, bins: int = 10, most: int | None = None) -> torch.Tensor:
    """Summed polarity of ever longer parts of time; see `MixedDensityStack`."""
    return MixedDensityStack(bins, most)(sample)
