"""Which part of a video is seen, and how its frames come into another size."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from math import inf
from typing import Literal, get_args

import cv2
import numpy as np

from nvsdata.data.frame_edges import MICROSECONDS
from nvsdata.video.picture import Frame

Fit = Literal["pad", "crop", "stretch"]


@dataclass(frozen=True)
class View:
    """Part of a video.

    - `start`, `stop`: s from its first frame; times then count from `start` (default: all of it)
    - `crop`: (x, y, width, height) in pixels of its frames (default: all of them)
    - `fit`: how frames of another shape come into a size: "pad", whole, with black beside them; "crop", filling it,
      with what doesn't fit left out; "stretch", distorted (default "pad")

    ValueError for an empty part, and for a `fit` that doesn't exist.
    """

    start: float = 0.0
    stop: float = inf
    crop: tuple[int, int, int, int] | None = None
    fit: Fit = "pad"

    def __post_init__(self) -> None:
        if not 0 <= self.start < self.stop:
            raise ValueError(f"start must be at least 0 and before stop, not {self.start} and {self.stop}")
        whole = self.crop is None or (len(self.crop) == 4 and all(isinstance(n, int) for n in self.crop))
        if not whole or (self.crop is not None and (min(self.crop[:2]) < 0 or min(self.crop[2:]) < 1)):
            raise ValueError(f"crop must be (x, y, width, height) within the frame, not {self.crop}")
        if self.fit not in get_args(Fit):
            raise ValueError(f"fit must be one of {', '.join(get_args(Fit))}, not {self.fit!r}")

    def between(self, frames: Iterator[Frame]) -> Iterator[Frame]:
        """The frames from `start` to `stop`. ValueError if there are none."""
        if (self.start, self.stop) == (0, inf):
            yield from frames
            return
        first: int | None = None
        begin, empty = round(self.start * MICROSECONDS), True
        for frame in frames:
            first = frame.time if first is None else first
            since = frame.time - first
            if since >= self.stop * MICROSECONDS:
                break
            if since >= begin:
                empty = False
                yield frame._replace(time=since - begin)
        if empty:
            raise ValueError(f"the video has no frames from {self.start:g} s to {self.stop:g} s")

    def shaped(self, frame: np.ndarray, size: tuple[int, int] | None, black: float = 0) -> np.ndarray:
        """What is seen of a frame [H, W] or [H, W, C], at `size` (width, height) if that is given.

        ValueError for a frame that doesn't hold all of `crop`.
        """
        if self.crop is not None:
            x, y, width, height = self.crop
            if x + width > frame.shape[1] or y + height > frame.shape[0]:
                raise ValueError(f"crop {self.crop} isn't within a frame of {frame.shape[1]}x{frame.shape[0]}")
            frame = frame[y : y + height, x : x + width]
        if size is None or size == (frame.shape[1], frame.shape[0]):
            return np.ascontiguousarray(frame)
        height, width = frame.shape[:2]
        across, down = size[0] / width, size[1] / height
        if self.fit == "stretch" or abs(across * height - size[1]) <= 0.5 or abs(down * width - size[0]) <= 0.5:
            return resized(frame, size)
        if self.fit == "pad":
            scale = min(across, down)
            inner = max(round(width * scale), 1), max(round(height * scale), 1)
            left, top = (size[0] - inner[0]) // 2, (size[1] - inner[1]) // 2
            around = np.full((size[1], size[0], *frame.shape[2:]), black, frame.dtype)
            around[top : top + inner[1], left : left + inner[0]] = resized(frame, inner)
            return around
        scale = max(across, down)
        keep = max(round(size[0] / scale), 1), max(round(size[1] / scale), 1)
        left, top = (width - keep[0]) // 2, (height - keep[1]) // 2
        return resized(frame[top : top + keep[1], left : left + keep[0]], size)


def resized(frame: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """A frame at another size, whatever its shape."""
    shrinks = size[0] < frame.shape[1] or size[1] < frame.shape[0]
    how = cv2.INTER_AREA if shrinks else cv2.INTER_LINEAR
    return np.asarray(cv2.resize(np.ascontiguousarray(frame), size, interpolation=how))


ALL = View()
