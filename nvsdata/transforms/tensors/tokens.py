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
    """Group events by time and polarity into tokens, one per patch (GET; Peng et al. 2023).

    The time from the first event to the last is divided into equal parts, each with a group of OFF and a group of ON
    events. The channels of a group are the number of events at each pixel of the patch, row by row, then the sum of
    their times, from 0 at the first event to 1 at the last. If patches divide the sensor evenly, the result equals that
    of the authors' code.

    Args:
        groups: Number of groups, twice the number of parts (default 12).
        patch: Side of a patch in pixels (default 4).

    Returns:
        float32 [groups 2 patch², H', W'], with H' x W' patches. Those at the right and at the bottom may extend beyond
        the sensor. The call takes `Events` or a `Recording`.

    Raises:
        ValueError: A setting is out of range.

    Example:
        >>> import nvsdata
        >>> from nvsdata import transforms as T
        >>> T.GroupTokens(groups=2, patch=4)(nvsdata.example()).shape
        torch.Size([64, 45, 60])
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
