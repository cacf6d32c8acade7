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
from nvsdata.kernels.represent.surfaces import sum_surfaces


@dataclass(frozen=True)
class HATS:
    """Compute histograms of averaged time surfaces (HATS; Sironi et al. 2018).

    The surface of an event sums exp(-(t_i - t_j) / tau) over earlier events in its cell, of its polarity and at most
    `window` earlier, for each offset (row, column) of up to `radius` pixels (equations 4 and 5). The surfaces of
    all events in a cell are summed, and divided by the number of its events of both polarities (equation 7). tonic's
    `ToAveragedTimesurface` also counts the event itself, and divides by the number of events of each polarity. The
    defaults are those of the paper for N-CARS.

    Args:
        cell: Side of a cell in pixels, K in the paper (default 10). Cells at the right and at the bottom may be
            smaller.
        radius: Largest offset in pixels, R in the paper (default 3).
        window: Duration in µs, Delta t in the paper (default 100,000).
        tau: Time constant in µs (default 1e9).

    Returns:
        float32 [cells, 2, 2 radius + 1, 2 radius + 1], with cells row by row and ON before OFF. Cells without events
        are 0. The call takes `Events` or a `Recording`.

    Raises:
        ValueError: A setting is out of range.

    Example:
        >>> from nvsdata import Events, transforms as T
        >>> T.HATS(cell=4, radius=1)(Events([0, 5, 10], [0, 1, 1], [0, 1, 0], [1, 1, 0], (8, 8))).shape
        torch.Size([4, 2, 3, 3])
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
        # kernel state of each pixel
        kept, epochs, members = (zeros(size, (2, *size[::-1]), kind) for kind in (np.float64, np.int64, np.int64))
        cells, side = math.prod(-(-pixels // cell) for pixels in size), 2 * radius + 1
        sums, counts = zeros(size, (cells, 2, side, side), np.float64), zeros(size, (cells,), np.int64)
        settings = cell, radius, min(int(self.window), EVER[1]), float(self.tau)
        sum_surfaces(*events.columns, *settings, kept, epochs, members, sums, counts)
        return torch.from_numpy((sums / np.maximum(counts, 1)[:, None, None, None]).astype(np.float32))
