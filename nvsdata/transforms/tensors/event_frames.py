"""Frames of events: numbers of events at each pixel, in parts of their time or of their number."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal, get_args

import numpy as np
import torch

from nvsdata.common.memory import zeros
from nvsdata.common.validation import microseconds, whole
from nvsdata.data.events import Events
from nvsdata.data.frame_edges import count_bounds, duration_bounds, equal_bounds
from nvsdata.data.recording import Recording, events_inside
from nvsdata.kernels.represent.frames import counted, marked

Values = Literal["count", "binary", "sum"]
Number = Literal["float32", "int16", "uint8"]


@dataclass(frozen=True)
class ToFrames:
    """Frames of events: [T, C, H, W]. Exactly one of the first three says how the events are divided.

    - `bins`: T, frames of equal duration over the time of the events (`Events.start` to `end`)
    - `duration`: of a frame in µs, from `Events.start` on; the last frame may reach beyond the end
    - `count`: events per frame; the last frame has those left over
    - `values`: "count" (default), the numbers of ON and of OFF events (C = 2, ON first); "binary", 1 where there are
      any; "sum", ON as +1 and OFF as -1 (C = 1)
    - `dtype`: "float32" (default); "int16" or "uint8", which take a half or a quarter of the memory: numbers beyond
      their range stay at its end, and uint8 holds no "sum"

    Takes `Events` or a `Recording`. Each event is in exactly one frame: frames are half open in time, the last one is
    closed. There is at least one frame. ValueError for settings out of range, and for more than 2^24 frames.

    `SumFrames` has the frames of the thesis (eq. 3.18), at a frame rate.
    """

    bins: int | None = None
    duration: int | None = None
    count: int | None = None
    values: Values = "count"
    dtype: Number = "float32"
    deterministic: ClassVar[bool] = True

    def __post_init__(self) -> None:
        given = {name: getattr(self, name) for name in ("bins", "duration", "count")}
        if sum(value is not None for value in given.values()) != 1:
            raise ValueError(f"exactly one of bins, duration and count must be given, not {given}")
        for name in ("bins", "count"):
            if given[name] is not None:
                whole(name, given[name], 1)
        if self.duration is not None:
            microseconds("duration", self.duration)
        if self.values not in get_args(Values):
            raise ValueError(f"values must be one of {get_args(Values)}, not {self.values!r}")
        if self.dtype not in get_args(Number):
            raise ValueError(f"dtype must be one of {get_args(Number)}, not {self.dtype!r}")
        if self.values == "sum" and self.dtype == "uint8":
            raise ValueError("sums may be negative, which uint8 isn't: choose int16")

    def __call__(self, sample: Events | Recording) -> torch.Tensor:
        events = events_inside(sample)
        width, height = events.sensor_size
        bounds = self._bounds(events)
        shape = bounds.size - 1, 1 if self.values == "sum" else 2, height, width
        out = zeros(events.sensor_size, shape, np.dtype(self.dtype))
        fill = marked if self.values == "binary" else counted
        fill(events.x, events.y, events.p, bounds, out)
        return torch.from_numpy(out)

    def _bounds(self, events: Events) -> np.ndarray:
        if self.bins is not None:
            return equal_bounds(events, int(self.bins))
        if self.duration is not None:
            return duration_bounds(events, int(self.duration))
        assert self.count is not None
        return count_bounds(events, int(self.count))


def to_frames(
    sample: Events | Recording,
    bins: int | None = None,
    *,
    duration: int | None = None,
    count: int | None = None,
    values: Values = "count",
    dtype: Number = "float32",
) -> torch.Tensor:
    """Frames of events; see `ToFrames`."""
    return ToFrames(bins, duration, count, values, dtype)(sample)
