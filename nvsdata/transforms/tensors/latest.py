"""Times of the latest events of each pixel."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import torch

from nvsdata.common.memory import zeros
from nvsdata.common.validation import not_negative, whole
from nvsdata.data.events import Events
from nvsdata.data.recording import Recording, events_inside
from nvsdata.kernels.represent.latest import counts_and_times, logarithms, logarithms_of_ages
from nvsdata.transforms.tensors.states import LatestState


@dataclass(frozen=True)
class FourChannels:
    """Compute the numbers of ON and of OFF events, and the times of the last ON and OFF event (Zhu et al. 2018).

    Returns:
        float32 [4, H, W], the input of EV-FlowNet. Times are scaled to 0 at `Events.start` and 1 at `Events.end`, and
        are 0 for pixels without events. The call takes `Events` or a `Recording`.

    Example:
        >>> from nvsdata import Events, transforms as T
        >>> T.FourChannels()(Events([0, 5, 10], [0, 0, 1], [0, 0, 0], [1, 1, 0], (2, 1)))[:, 0].tolist()
        [[2.0, 0.0], [0.0, 1.0], [0.5, 0.0], [0.0, 1.0]]
    """

    deterministic: ClassVar[bool] = True

    def __call__(self, sample: Events | Recording) -> torch.Tensor:
        events = events_inside(sample)
        width, height = events.sensor_size
        out = zeros(events.sensor_size, (4, height, width))
        counts_and_times(*events.columns, events.start, max(events.end - events.start, 1), out)
        return torch.from_numpy(out)


@dataclass(frozen=True)
class TORE:
    """Compute logarithms of the ages of the `k` latest events of each pixel and polarity (TORE; Baldwin et al. 2022).

    The values are log(age + 1) - log(`shortest` + 1), at least 0, with ages in µs at `Events.end`. Ages above
    `longest`, and those of missing events, count as `longest`. For streams, see `state`.

    Args:
        k: Number of events of each pixel and polarity (default 3).
        shortest: Age in µs up to which values are 0 (default 150, as in the authors' code).
        longest: Largest age in µs (default 5,000,000, as in the authors' code).

    Returns:
        float32 [2 k, H, W]. ON comes first; within a polarity, the latest event comes first. The call takes `Events` or
        a `Recording`.

    Raises:
        ValueError: A setting is out of range.

    Example:
        >>> from nvsdata import Events, transforms as T
        >>> T.TORE(k=3)(Events([0, 5, 10], [0, 1, 1], [0, 1, 0], [1, 1, 0], (8, 6))).shape
        torch.Size([6, 6, 8])
    """

    k: int = 3
    shortest: float = 150
    longest: float = 5_000_000
    deterministic: ClassVar[bool] = True

    def __post_init__(self) -> None:
        whole("k", self.k, 1)
        not_negative("shortest", self.shortest)
        not_negative("longest", self.longest)
        if self.longest < self.shortest:
            raise ValueError(f"longest must be at least shortest, not {self.longest} < {self.shortest}")

    def __call__(self, sample: Events | Recording) -> torch.Tensor:
        events = events_inside(sample)
        size = events.sensor_size[::-1]
        least, most = np.log1p(float(self.shortest)), np.log1p(float(self.longest))
        out = zeros(events.sensor_size, (2, int(self.k), *size), fill=most - least)
        logarithms_of_ages(
            *events.columns, events.end, least, most, zeros(events.sensor_size, (2, *size), np.int32), out
        )
        return torch.from_numpy(out).flatten(0, 1)

    def state(self, sensor_size: tuple[int, int]) -> LatestState:
        """Return a state for a stream: `update(events)` takes the next events, `tensor()` returns [2 k, H, W]."""
        k, least, most = int(self.k), np.log1p(float(self.shortest)), np.log1p(float(self.longest))

        def shown(ages: np.ndarray, known: np.ndarray) -> np.ndarray:
            shape = 2 * k, *ages.shape[2:]
            return logarithms(ages.ravel(), known.ravel(), least, most).reshape(shape)

        return LatestState(sensor_size, k, shown)
