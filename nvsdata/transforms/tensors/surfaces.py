"""Time surfaces: the time of the last event of each pixel."""

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
    """Compute exp(-(T - t) / tau), with t the time of the last event of each pixel and polarity, and 0 without event.

    The exponential kernel is that of HOTS (Lagorce et al. 2017, equation 3), on the entire sensor. For streams, see
    `state`.

    Args:
        tau: Time constant in µs (default 50,000).
        every: Time between surfaces in µs. By default (None) there is a single surface, at the end of the events' time,
            T = `Events.end`. Otherwise T = `Events.start` + `every`, + 2 `every`, ...; the last surface is at the end.

    Returns:
        float32 [2, H, W], ON first, or with `every` [S, 2, H, W]. The call takes `Events` or a `Recording`.

    Raises:
        ValueError: A setting is out of range, or there are more than 2^24 surfaces.

    Example:
        >>> from nvsdata import Events, transforms as T
        >>> T.TimeSurface(10)(Events([0, 10], [0, 1], [0, 0], [1, 1], (2, 1)))[0]
        tensor([[0.3679, 1.0000]])
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
        # memory for the surfaces, and for float64 [2, H, W]
        check_memory(events.sensor_size, (count + 2, 2, height, width))
        out = np.empty((count, 2, height, width), np.float32)
        grown = zeros(events.sensor_size, out.shape[1:], np.float64)
        kernel.surfaces(*events.columns, times, bounds, float(self.tau), grown, out)
        return torch.from_numpy(out if self.every is not None else out[0])

    def state(self, sensor_size: tuple[int, int]) -> LatestState:
        """Return a state for a stream: `update(events)` takes the next events, `tensor()` returns [2, H, W]."""

        def shown(ages: np.ndarray, known: np.ndarray) -> np.ndarray:
            return np.where(known, np.exp(-np.where(known, ages, 0) / self.tau), 0)[:, 0]

        return LatestState(sensor_size, 1, shown)


@dataclass(frozen=True)
class EventSurfaces:
    """Compute the time surface around each event.

    The surface is exp(-(t_i - t) / tau), with t the time of the last event at each pixel up to event i. It is 1 at the
    center, where event i is, and 0 at pixels without events and beyond the sensor. HOTS (Lagorce et al. 2017, equations
    2 and 3) has a surface for each polarity: `polarity="both"`.

    Args:
        radius: Distance in pixels from the center to the border of the square surface, R in HOTS (default 2).
        tau: Time constant in µs (default 50,000).
        polarity: "own" (default) for the surface of the event's own polarity, "both" for one surface per polarity.

    Returns:
        float32 [N, 2 radius + 1, 2 radius + 1] for N events, or [N, 2, 2 radius + 1, 2 radius + 1], ON first. The call
        takes `Events` or a `Recording`.

    Raises:
        ValueError: A setting is out of range.

    Example:
        >>> from nvsdata import Events, transforms as T
        >>> T.EventSurfaces(radius=1)(Events([0, 10], [0, 1], [0, 0], [1, 1], (2, 1))).shape
        torch.Size([2, 3, 3])
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
