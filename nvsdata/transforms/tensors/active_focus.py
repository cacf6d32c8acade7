"""Queues of the latest bins of time with events, for each pixel (temporal active focus)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import torch

from nvsdata.common.validation import microseconds, whole
from nvsdata.data.events import LATEST, Events
from nvsdata.data.recording import Recording, as_events
from nvsdata.transforms.tensors.states import FocusState


@dataclass(frozen=True)
class TAF:
    """Compute the ages of the latest bins of time with events, for each pixel and polarity (TAF; Liu et al. 2023).

    Time is divided into bins of `duration` from `Events.start` on. For each of the latest `depth` bins with events, the
    mean time of these events is kept. Its age at the end (`Events.end`), in units of `duration`, becomes
    max(0, 1 - log(1 + age) / 8.7). Values of missing bins are 0. For streams, see `state`.

    Args:
        depth: Number of bins kept (default 8).
        duration: Duration of a bin in µs (default 10,000).

    Returns:
        float32 [2 depth, H, W]. The latest bin comes last. Within a bin, OFF comes before ON, as in the authors' code.
        The call takes `Events` or a `Recording`.

    Raises:
        ValueError: A setting isn't a positive integer.

    Example:
        >>> from nvsdata import Events, transforms as T
        >>> T.TAF(depth=4)(Events([0, 5, 10], [0, 1, 1], [0, 1, 0], [1, 1, 0], (8, 6))).shape
        torch.Size([8, 6, 8])
    """

    depth: int = 8
    duration: int = 10_000
    deterministic: ClassVar[bool] = True

    def __post_init__(self) -> None:
        whole("depth", self.depth, 1)
        microseconds("duration", self.duration)

    def __call__(self, sample: Events | Recording) -> torch.Tensor:
        events = as_events(sample)
        state = self.state(events.sensor_size)
        state.update(events)
        return state.tensor()

    def state(self, sensor_size: tuple[int, int]) -> FocusState:
        """Return a state for a stream, with `update(events)` and `tensor()`. Bins begin at the first events."""
        return FocusState(sensor_size, int(self.depth), min(int(self.duration), LATEST))
