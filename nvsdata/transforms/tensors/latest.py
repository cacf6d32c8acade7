"""The latest events of each pixel."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import torch

from nvsdata.common.memory import zeros
from nvsdata.common.validation import not_negative, whole
from nvsdata.data.events import Events
from nvsdata.data.recording import Recording, events_inside
from nvsdata.kernels.represent.latest import logarithms, logarithms_of_ages
from nvsdata.transforms.tensors.states import LatestState


@dataclass(frozen=True)
class TORE:
    """Logarithms of the ages of each pixel's `k` latest events: float32 [2 k, H, W] (Baldwin et al. 2022).

    log(age + 1) - log(`shortest` + 1) at the end of the events' time (`Events.end`), at least 0; ages above `longest`,
    and of events that there weren't, count as `longest`. ON comes first, of each polarity the latest event.

    - `k`: events of each pixel and polarity (default 3)
    - `shortest`, `longest`: µs (default 150 and 5,000,000, as in the authors' code)

    Takes `Events` or a `Recording`. ValueError for settings out of range.
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
        """For events that come piece by piece: `state.update(events)`, `state.tensor()`."""
        k, least, most = int(self.k), np.log1p(float(self.shortest)), np.log1p(float(self.longest))

        def shown(ages: np.ndarray, known: np.ndarray) -> np.ndarray:
            shape = 2 * k, *ages.shape[2:]
            return logarithms(ages.ravel(), known.ravel(), least, most).reshape(shape)

        return LatestState(sensor_size, k, shown)


def tore(sample: Events | Recording, k: int = 3, *, shortest: float = 150, longest: float = 5_000_000) -> torch.Tensor:
    """Logarithms of the ages of each pixel's latest events; see `TORE`."""
    return TORE(k, shortest, longest)(sample)
