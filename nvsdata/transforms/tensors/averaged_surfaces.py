"""Histograms of averaged time surfaces (HATS)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import torch

from nvsdata.common.memory import zeros
from nvsdata.common.validation import microseconds, positive, whole
from nvsdata.data.events import EVER, Events
from nvsdata.data.recording import Recording, events_inside
from nvsdata.kernels.represent.hats import sum_surfaces


@dataclass(frozen=True)
class HATS:
    """Histograms of averaged time surfaces (Sironi et al. 2018): float32 [cells, 2, 2 radius + 1, 2 radius + 1].

    Each event has the sum of exp(-(t_i - t_j) / tau) over earlier events of its polarity within `window`, by their
    offset (row, column) within `radius`, of its own cell alone (eq. 4 and 5). These surfaces are summed over the events
    of a cell, ON first, and divided by their number, of both polarities (eq. 7). Cells are in order of rows.

    - `cell`: K, side of a cell in pixels (default 10); cells at the right and at the bottom may be smaller
    - `radius`: R in pixels (default 3)
    - `window`: Delta t in µs (default 100,000)
    - `tau`: time constant in µs (default 1e9); defaults are the paper's for N-CARS

    Takes `Events` or a `Recording`. Cells without events are 0. ValueError for settings out of range. (tonic's
    `ToAveragedTimesurface` also counts the event itself, and divides by the number of events of each polarity.)
    """

    cell: int = 10
    radius: int = 3
    window: int = 100_000
    tau: float = 1e9
    deterministic: ClassVar[bool] = True

    def __post_init__(self) -> None:
        whole("cell", self.cell, 1)
        whole("radius", self.radius)
        microseconds("window", self.window)
        positive("tau", self.tau)

    def __call__(self, sample: Events | Recording) -> torch.Tensor:
        events = events_inside(sample)
        size, cell, radius = events.sensor_size, int(self.cell), int(self.radius)
        # the sums, epochs and numbers of events of pixels
        kept, epochs, members = (zeros(size, (2, *size[::-1]), kind) for kind in (np.float64, np.int64, np.int64))
        cells, side = math.prod(-(-pixels // cell) for pixels in size), 2 * radius + 1
        sums, counts = zeros(size, (cells, 2, side, side), np.float64), zeros(size, (cells,), np.int64)
        settings = cell, radius, min(int(self.window), EVER[1]), float(self.tau)
        sum_surfaces(*events.columns, *settings, kept, epochs, members, sums, counts)
        return torch.from_numpy((sums / np.maximum(counts, 1)[:, None, None, None]).astype(np.float32))


def hats(
    sample: Events | Recording, cell: int = 10, radius: int = 3, *, window: int = 100_000, tau: float = 1e9
) -> torch.Tensor:
    """Histograms of averaged time surfaces; see `HATS`."""
    return HATS(cell, radius, window, tau)(sample)
