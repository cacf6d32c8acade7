"""Frames of events: counts or summed polarity at each pixel, by duration or by number of events."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, Literal, get_args

import numpy as np
import torch

from nvsdata.common.memory import zeros
from nvsdata.common.validation import microseconds, positive, whole
from nvsdata.data.boxes import Boxes
from nvsdata.data.events import Events
from nvsdata.data.frame_edges import count_bounds, duration_bounds, equal_bounds, frame_bounds, frame_edges
from nvsdata.data.recording import Recording, events_inside
from nvsdata.kernels.represent.frames import counted, marked, sum_frames
from nvsdata.transforms.apply import move_boxes
from nvsdata.transforms.events.crops import downsample

Values = Literal["count", "binary", "sum"]
Number = Literal["float32", "int16", "uint8"]


@dataclass(frozen=True)
class ToFrames:
    """Divide events into frames. Exactly one of `bins`, `duration`, `count` and `fps` must be given.

    Each event is in exactly one frame, and there is at least one frame. A frame includes its start but not its end; the
    last one includes both. The frames of equation 3.18 of the thesis are `ToFrames(fps=30, values="sum", factor=8)`.

    Args:
        bins: Number of frames of equal duration, from `Events.start` to `Events.end`.
        duration: Duration of a frame in µs, from `Events.start` on. The last frame may end after the events.
        count: Number of events per frame. The last frame has the remaining ones.
        fps: Frames per second, from `Events.start` on. In this case, a frame includes its end but not its start,
            because an emulator's events of a video frame may occur exactly at the time of the video frame.
        values: "count" (default), the numbers of ON and of OFF events; "binary", 1 where there are any; "sum", the sum
            of polarities, ON as +1 and OFF as -1.
        dtype: "float32" (default), or "int16" or "uint8", which take a half or a quarter of the memory. Numbers are
            clipped to the range of the type. "uint8" can't represent a "sum".
        factor: Side in pixels of the cells over which float32 sums are averaged (default 1: no average). Cells at the
            right and at the bottom may be smaller.

    Returns:
        [T, 2, H, W], ON first; for "sum" [T, H, W]. The call takes `Events` or a `Recording`.

    Raises:
        ValueError: A setting is out of range, or there are more than 2^24 frames.

    Example:
        >>> import nvsdata
        >>> from nvsdata import transforms as T
        >>> events = nvsdata.example()
        >>> T.ToFrames(duration=100_000)(events).shape
        torch.Size([5, 2, 180, 240])
        >>> T.ToFrames(fps=30, values="sum", factor=8)(events).shape
        torch.Size([15, 23, 30])
    """

    bins: int | None = None
    duration: int | None = None
    count: int | None = None
    fps: float | None = None
    values: Values = "count"
    dtype: Number = "float32"
    factor: int = 1
    deterministic: ClassVar[bool] = True

    def __post_init__(self) -> None:
        given = {name: getattr(self, name) for name in ("bins", "duration", "count", "fps")}
        if sum(value is not None for value in given.values()) != 1:
            raise ValueError(f"exactly one of bins, duration, count and fps must be given, not {given}")
        for name in ("bins", "count"):
            if given[name] is not None:
                whole(name, given[name], 1)
        if self.duration is not None:
            microseconds("duration", self.duration)
        if self.fps is not None:
            positive("fps", self.fps)
        if self.values not in get_args(Values):
            raise ValueError(f"values must be one of {get_args(Values)}, not {self.values!r}")
        if self.dtype not in get_args(Number):
            raise ValueError(f"dtype must be one of {get_args(Number)}, not {self.dtype!r}")
        if self.values == "sum" and self.dtype == "uint8":
            raise ValueError("sums may be negative, which uint8 isn't: choose int16")
        whole("factor", self.factor, 1)
        if self.factor > 1 and (self.values, self.dtype) != ("sum", "float32"):
            raise ValueError('factor averages sums: choose values="sum" and dtype="float32"')

    def __call__(self, sample: Events | Recording) -> torch.Tensor:
        events = events_inside(sample)
        width, height = events.sensor_size
        bounds, columns = self._bounds(events), (events.x, events.y, events.p)
        if self.factor > 1:
            factor = int(self.factor)
            out = zeros(events.sensor_size, (bounds.size - 1, -(-height // factor), -(-width // factor)))
            sum_frames(*columns, bounds, events.sensor_size, factor, out)
            return torch.from_numpy(out)
        shape = bounds.size - 1, 1 if self.values == "sum" else 2, height, width
        out = zeros(events.sensor_size, shape, np.dtype(self.dtype))
        (marked if self.values == "binary" else counted)(*columns, bounds, out)
        return torch.from_numpy(out[:, 0] if self.values == "sum" else out)

    def with_boxes(self, sample: Any, boxes: Boxes) -> tuple[torch.Tensor, Boxes]:
        """Return the frames, and the boxes at their resolution."""
        frames, factor = self(sample), int(self.factor)
        return frames, move_boxes(sample, boxes, lambda part: downsample(part, factor)) if factor > 1 else boxes

    def _bounds(self, events: Events) -> np.ndarray:
        if self.bins is not None:
            return equal_bounds(events, int(self.bins))
        if self.duration is not None:
            return duration_bounds(events, int(self.duration))
        if self.fps is not None:
            return frame_bounds(events, events.start, frame_edges(events.end - events.start, self.fps))
        assert self.count is not None
        return count_bounds(events, int(self.count))
