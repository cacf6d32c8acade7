"""Stacks of histograms: of equal parts of time, and of parts that double in length."""

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
    """Count events in equal parts of time (RVT; Gehrig & Scaramuzza 2023).

    The bins divide the time from the first event to the last into equal parts. A bin includes its start but not its
    end; the last one includes both.

    Args:
        bins: Number of parts (default 10).
        most: Maximum to which counts are clipped (default 10).

    Returns:
        float32 [2 bins, H, W] (RVT stores uint8), all bins of OFF, then all of ON. The call takes `Events` or a
        `Recording`.

    Raises:
        ValueError: A setting isn't a positive integer.

    Example:
        >>> from nvsdata import Events, transforms as T
        >>> T.StackedHistogram(bins=5)(Events([0, 5, 10], [0, 1, 1], [0, 1, 0], [1, 1, 0], (8, 6))).shape
        torch.Size([10, 6, 8])
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
    """Sum polarity over parts of time of increasing length (Nam et al. 2022, as in RVT).

    Channel i, counted from 0, sums the first 2^(i + 1 - bins) of the time from the first event to the last. The last
    channel has all events.

    Args:
        bins: Number of channels, at most 60 (default 10).
        most: Limit of the absolute value of the sums (default None: no limit).

    Returns:
        float32 [bins, H, W] (RVT stores int8). The call takes `Events` or a `Recording`.

    Raises:
        ValueError: A setting isn't a positive integer, or there are more than 60 bins.

    Example:
        >>> from nvsdata import Events, transforms as T
        >>> T.MixedDensityStack(bins=2)(Events([0, 5, 10], [0, 0, 1], [0, 0, 0], [1, 1, 0], (2, 1))).tolist()
        [[[1.0, 0.0]], [[2.0, -1.0]]]
    """

    bins: int = 10
    most: int | None = None
    deterministic: ClassVar[bool] = True

    def __post_init__(self) -> None:
        whole("bins", self.bins, 1)
        if self.bins > 60:
            raise ValueError(f"bins must be at most 60, not {self.bins}: a part of 2^-60 contains no µs")
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
