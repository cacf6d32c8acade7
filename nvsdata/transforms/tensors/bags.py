"""Bags of events (Peng et al. 2017)."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import ClassVar

import torch

from nvsdata.common.validation import whole
from nvsdata.data.events import Events
from nvsdata.data.recording import Recording, as_events
from nvsdata.transforms.tensors.event_frames import to_frames


@dataclass(frozen=True)
class BagOfEvents:
    """How often events occurred at each pixel, in segments of `count` events: float32 [S, H, W] (Peng et al. 2017).

    Each segment sums to 1; S is the number of complete segments, and the events after them are left out. Polarities
    count alike. The authors multiply the frequencies by the information that a pixel's events have, which is learnt
    from the training set: see `bag_weights`.

    - `count`: events of a segment (default 300, as in the authors' code)

    Takes `Events` or a `Recording`. ValueError unless `count` is a positive whole number.
    """

    count: int = 300
    deterministic: ClassVar[bool] = True

    def __post_init__(self) -> None:
        whole("count", self.count, 1)

    def __call__(self, sample: Events | Recording) -> torch.Tensor:
        return bag_of_events(sample, int(self.count))


def bag_of_events(sample: Events | Recording, count: int = 300) -> torch.Tensor:
    """Frequencies of events in segments of `count`; see `BagOfEvents`."""
    events = as_events(sample)
    complete = len(events) // count
    if not complete:
        return torch.zeros(0, events.sensor_size[1], events.sensor_size[0])
    return to_frames(events[: complete * count], count=count).sum(1) / count


def bag_weights(bags: Iterable[torch.Tensor]) -> torch.Tensor:
    """The information of each pixel's events, to multiply bags by: log(S / (n + 1)), float32 [H, W].

    - `bags`: those of the training set, [S_i, H, W] each, read once; S is the number of all segments, n that of the
      segments in which the pixel has events

    ValueError for bags without any segment, or of different sensors.
    """
    total, seen = 0, None
    for bag in bags:
        found = (bag > 0).sum(0)
        if seen is not None and found.shape != seen.shape:
            raise ValueError(f"bags of different sensors: {list(seen.shape)} and {list(found.shape)}")
        total, seen = total + len(bag), found if seen is None else seen + found
    if seen is None or not total:
        raise ValueError("bags without any segment: have recordings fewer events than one segment?")
    return torch.log(total / (seen.double() + 1)).float()
