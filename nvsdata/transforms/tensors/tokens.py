"""Tokens of events, for transformers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import torch

from nvsdata.common.memory import zeros
from nvsdata.common.validation import whole
from nvsdata.data.events import Events
from nvsdata.data.frame_edges import check_count, fraction_bounds
from nvsdata.data.recording import Recording, events_inside
from nvsdata.kernels.represent.measures import tokens


@dataclass(frozen=True)
class GroupTokens:
    """Tokens of groups by time and polarity, one per patch: float32 [groups 2 patch², H', W'] (GET, Peng et al. 2023).

    Channels are those of the first part of the time, OFF and ON, then of the second, and so on; of each group first the
    number of events at each pixel of the patch, row by row, then the sum of their times, from 0 at the first event to 1
    at the last. H' and W' are numbers of patches; those at the right and at the bottom may reach beyond the sensor.

    - `groups`: twice the number of parts of the time (default 12)
    - `patch`: side of a patch in pixels (default 4)

    Takes `Events` or a `Recording`. ValueError for settings out of range. (Where patches fill
    the sensor, the authors' code gives the same.)
    """

    groups: int = 12
    patch: int = 4
    deterministic: ClassVar[bool] = True

    def __post_init__(self) -> None:
        whole("groups", self.groups, 2)
        whole("patch", self.patch, 1)
        if self.groups % 2:
            raise ValueError(f"groups must be even, not {self.groups}: half of them are of each polarity")
        check_count(int(self.groups))

    def __call__(self, sample: Events | Recording) -> torch.Tensor:
        events, parts, patch = events_inside(sample), int(self.groups) // 2, int(self.patch)
        width, height = (-(-side // patch) for side in events.sensor_size)
        out = zeros(events.sensor_size, (parts, 2, 2, patch * patch, height, width))
        if len(events):
            # the last event is in the last part
            bounds = fraction_bounds(
                events, int(events.t[0]), int(events.t[-1]) + 1, [(n, parts) for n in range(parts)]
            )
            tokens(*events.columns, bounds, patch, out)
        return torch.from_numpy(out).flatten(0, 3)


def group_tokens(sample: Events | Recording, groups: int = 12, patch: int = 4) -> torch.Tensor:
    """Tokens of groups by time and polarity; see `GroupTokens`."""
    return GroupTokens(groups, patch)(sample)
