"""Bags of events (Peng et al. 2017)."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import ClassVar

import torch

from nvsdata.common.validation import whole
from nvsdata.data.events import Events
from nvsdata.data.recording import Recording, as_events
from nvsdata.transforms.tensors.event_frames import ToFrames


@dataclass(frozen=True)
class BagOfEvents:
    """Compute the frequency of events at each pixel, in segments of `count` events (Peng et al. 2017).

    ON and OFF events count alike. The authors multiply the frequencies by the information of events at the pixel, which
    `bag_weights` computes from the training set.

    Args:
        count: Number of events in a segment (default 300, as in the authors' code).

    Returns:
        float32 [S, H, W] for S complete segments; each [H, W] sums to 1. The events after the last complete segment are
        left out. The call takes `Events` or a `Recording`.

    Raises:
        ValueError: `count` isn't a positive integer.

    Example:
        >>> from nvsdata import Events, transforms as T
        >>> T.BagOfEvents(2)(Events([0, 5, 10], [0, 1, 1], [0, 0, 0], [1, 1, 0], (2, 1))).tolist()
        [[[0.5, 0.5]]]
    """

    count: int = 300
    deterministic: ClassVar[bool] = True

    def __post_init__(self) -> None:
        whole("count", self.count, 1)

    def __call__(self, sample: Events | Recording) -> torch.Tensor:
        events, count = as_events(sample), int(self.count)
        complete = len(events) // count
        if not complete:
            return torch.zeros(0, events.sensor_size[1], events.sensor_size[0])
        return ToFrames(count=count)(events[: complete * count]).sum(1) / count


def bag_weights(bags: Iterable[torch.Tensor]) -> torch.Tensor:
    """Compute the information of events at each pixel, log(S / (n + 1)), by which bags are multiplied.

    S is the number of all segments, and n the number of segments in which the pixel has events.

    Args:
        bags: Bags of the training set, [S_i, H, W] each. They are iterated over once.

    Returns:
        float32 [H, W].

    Raises:
        ValueError: There is no segment, or the sensors differ.

    Example:
        >>> import torch
        >>> from nvsdata import transforms as T
        >>> T.bag_weights([torch.tensor([[[0.5, 0.5]], [[1.0, 0.0]]])]).exp()
        tensor([[0.6667, 1.0000]])
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
