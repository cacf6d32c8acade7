"""Statistics of the events of each pixel, selected by a search (ERGO-12)."""

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
# index of the window, polarity, quantity and measure, as in the authors' code
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
    """Compute twelve statistics of the events of each pixel, selected by a search (ERGO-12; Zubic et al. 2023).

    A channel is a statistic of the part of the events that is given here in parentheses; parts are by number of events.
    Times are scaled to 0..1 over all events. The channels are: variance of the polarity ±1 (all events), variance of
    OFF times (third third), 1 where there are OFF events (second third), sum of the polarity (last eighth), 1 where
    there are ON events (last quarter), number of events (last eighth), mean ON time (second third), 1 where there are
    OFF events (last quarter), latest OFF time (first third), latest ON time (all events), latest time (last half), 1
    where there are events (first third).

    Returns:
        float32 [12, H, W], 0 at pixels without events in the part. The authors' code also multiplies by 255. The call
        takes `Events` or a `Recording`.

    Example:
        >>> from nvsdata import Events, transforms as T
        >>> T.ERGO12()(Events([0, 5, 10], [0, 1, 1], [0, 1, 0], [1, 1, 0], (8, 6))).shape
        torch.Size([12, 6, 8])
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
    """Return index ranges: all of `count` events, each third of them, and the last half, quarter and eighth."""
    third = count // 3
    found = [(0, count), *((n * third, (n + 1) * third) for n in range(3))]
    first, left = 0, count
    for _ in range(3):
        left //= 2
        first += left
        found.append((first, count))
    return found
