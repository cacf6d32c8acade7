"""Time surfaces: when pixels last had an event."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal, get_args

import numpy as np
import torch

from nvsdata.common.memory import check_memory, zeros
from nvsdata.common.validation import microseconds, positive, whole
from nvsdata.data.events import EVER, Events
from nvsdata.data.frame_edges import duration_bounds
from nvsdata.data.recording import Recording, events_inside
from nvsdata.kernels.represent import surfaces as kernel
from nvsdata.transforms.tensors.states import LatestState

Polarity = Literal["own", "both"]


@dataclass(frozen=True)
class TimeSurface:
    """exp(-(T - t) / tau), t being the time of a pixel's last event of a polarity: float32 [2, H, W], ON first.

    - `tau`: time constant in µs (default 50,000)
    - `every`: µs between surfaces (default None: a single one, at the end of the events' time, `Events.end`). Otherwise
      the result is [S, 2, H, W], with T = `Events.start` + `every`, + 2 `every`, ...; the last one is at the end

    0 where there was no event. Takes `Events` or a `Recording`. ValueError for settings out of range, and for more than
    2^24 surfaces. The exponential kernel is that of HOTS (Lagorce et al. 2017, eq. 3), on the whole sensor.
    """

    tau: float = 50_000
    every: int | None = None
    deterministic: ClassVar[bool] = True

    def __post_init__(self) -> None:
        positive("tau", self.tau)
        if self.every is not None:
            microseconds("every", self.every)

    def __call__(self, sample: Events | Recording) -> torch.Tensor:
        events = events_inside(sample)
        width, height = events.sensor_size
        bounds = np.array([0, len(events)]) if self.every is None else duration_bounds(events, self.every)
        count = bounds.size - 1
        times = np.full(count, events.end)
        if self.every is not None:
            times[:-1] = events.start + np.arange(1, count) * min(int(self.every), EVER[1])
        # the surfaces, and float64 [2, H, W]
        check_memory(events.sensor_size, (count + 2, 2, height, width))
        out = np.empty((count, 2, height, width), np.float32)
        grown = zeros(events.sensor_size, out.shape[1:], np.float64)
        kernel.surfaces(*events.columns, times, bounds, float(self.tau), grown, out)
        return torch.from_numpy(out if self.every is not None else out[0])

    def state(self, sensor_size: tuple[int, int]) -> LatestState:
        """For events that come piece by piece: `state.update(events)`, `state.tensor()` [2, H, W]."""

        def shown(ages: np.ndarray, known: np.ndarray) -> np.ndarray:
            return np.where(known, np.exp(-np.where(known, ages, 0) / self.tau), 0)[:, 0]

        return LatestState(sensor_size, 1, shown)


@dataclass(frozen=True)
class EventSurfaces:
    """The time surface around each event: float32 [N, 2 radius + 1, 2 radius + 1], of the event's own polarity.

    exp(-(t_i - t) / tau), t being the time of the last event of a polarity at each pixel up to event i, whose own value
    in the middle is 1. 0 where there was none, and beyond the sensor. HOTS (Lagorce et al. 2017, eq. 2 and 3) has a
    surface for each polarity: `polarity="both"`.

    - `radius`: R, pixels around the event (default 2)
    - `tau`: time constant in µs (default 50,000)
    - `polarity`: "own" (default), that of the event; "both" gives [N, 2, 2 radius + 1, 2 radius + 1], ON first

    Takes `Events` or a `Recording`. ValueError for settings out of range.
    """

    radius: int = 2
    tau: float = 50_000
    polarity: Polarity = "own"
    deterministic: ClassVar[bool] = True

    def __post_init__(self) -> None:
        whole("radius", self.radius)
        positive("tau", self.tau)
        if self.polarity not in get_args(Polarity):
            raise ValueError(f"polarity must be one of {get_args(Polarity)}, not {self.polarity!r}")

    def __call__(self, sample: Events | Recording) -> torch.Tensor:
        events = events_inside(sample)
        width, height = events.sensor_size
        radius, side = int(self.radius), 2 * int(self.radius) + 1
        padded = 2, height + side - 1, width + side - 1
        grown, epochs = (zeros(events.sensor_size, padded, kind) for kind in (np.float64, np.int64))
        both = self.polarity == "both"
        out = np.empty((len(events), 1 + both, side, side), np.float32)
        kernel.event_surfaces(*events.columns, float(self.tau), radius, grown, epochs, out)
        return torch.from_numpy(out if both else out[:, 0])


def time_surface(sample: Events | Recording, tau: float = 50_000, *, every: int | None = None) -> torch.Tensor:
    """How long ago pixels had their last event; see `TimeSurface`."""
    return TimeSurface(tau, every)(sample)


def event_surfaces(
    sample: Events | Recording, radius: int = 2, tau: float = 50_000, *, polarity: Polarity = "own"
) -> torch.Tensor:
    """The time surface around each event; see `EventSurfaces`."""
    return EventSurfaces(radius, tau, polarity)(sample)
