"""Measures of pixels' events that a search chose (ERGO-12)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import torch

from nvsdata.common.memory import zeros
from nvsdata.data.events import Events
from nvsdata.data.recording import Recording, events_inside
from nvsdata.kernels.represent import measures as kernel
from nvsdata.kernels.represent.measures import COUNT, MAX, MEAN, POLARITY, SUM, TIME, VARIANCE

ANY, OFF, ON = -1, 0, 1
# number of the window, polarity, what is measured, and how, as in the authors' code
CHANNELS = (
    (0, ANY, POLARITY, VARIANCE),
    (3, OFF, TIME, VARIANCE),
    (2, OFF, COUNT, MEAN),
    (6, ANY, POLARITY, SUM),
    (5, ON, COUNT, MEAN),
    (6, ANY, COUNT, SUM),
    (2, ON, TIME, MEAN),
    (5, OFF, COUNT, MEAN),
    (1, OFF, TIME, MAX),
    (0, ON, TIME, MAX),
    (4, ANY, TIME, MAX),
    (1, ANY, COUNT, MEAN),
)


@dataclass(frozen=True)
class ERGO12:
    """Twelve measures of each pixel's events that a search chose: float32 [12, H, W] (ERGO-12, Zubic et al. 2023).

    In order, with the part of the events that they are of (thirds, and what is left after the first half, 3/4 and 7/8,
    by number; times are scaled to 0..1 over all): variance of the polarity ±1 (all), variance of OFF times (third
    third), whether OFF (second third), sum of the polarity (last eighth), whether ON (last quarter), number (last
    eighth), mean ON time (second third), whether OFF (last quarter), latest OFF time (first third), latest ON time
    (all), latest time (last half), whether any (first third).

    Takes `Events` or a `Recording`. 0 where there are no such events. (The authors' code then multiplies by 255.)
    """

    deterministic: ClassVar[bool] = True

    def __call__(self, sample: Events | Recording) -> torch.Tensor:
        events = events_inside(sample)
        size = events.sensor_size[::-1]
        out = zeros(events.sensor_size, (len(CHANNELS), *size))
        scratch = zeros(events.sensor_size, (3, *size), np.float64)
        if len(events):
            (t, x, y, p), start, span = events.columns, int(events.t[0]), events.duration
            windows = _windows(len(events))
            for plane, (window, polarity, quantity, measure) in zip(out, CHANNELS, strict=True):
                bounds = windows[window]
                kernel.measured(t, x, y, p, start, span, *bounds, polarity, quantity, measure, scratch, plane)
        return torch.from_numpy(out)


def _windows(count: int) -> list[tuple[int, int]]:
    """All of the events, the thirds, and what is left when the first half is taken off once, twice and three times."""
    third = count // 3
    found = [(0, count), *((n * third, (n + 1) * third) for n in range(3))]
    first, left = 0, count
    for _ in range(3):
        left //= 2
        first += left
        found.append((first, count))
    return found


def ergo12(sample: Events | Recording) -> torch.Tensor:
    """Twelve measures of each pixel's events; see `ERGO12`."""
    return ERGO12()(sample)
