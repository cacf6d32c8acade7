"""Part of a video, and fitting of its frames to another size."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from math import inf
from typing import Literal, get_args

import cv2
import numpy as np

from nvsdata.data.frame_edges import MICROSECONDS
from nvsdata.video.video_frame import VideoFrame

FitMode = Literal["pad", "crop", "stretch"]


@dataclass(frozen=True)
class VideoView:
    """Part of a video, and how its frames are fitted to a size.

    Args:
        start: Start of the part in seconds from the first frame; times are then relative to it.
        stop: Seconds from the first frame at which the part ends.
        crop: (x, y, width, height) in pixels of the frames (default: all of each).
        fit: Way to fit frames of another aspect ratio: "pad" shows the entire frame and fills the rest with black,
            "crop" fills the size and cuts off what is outside, "stretch" distorts.

    Raises:
        ValueError: The part is empty, or `crop` or `fit` is invalid.

    Example:
        >>> import numpy as np
        >>> VideoView(fit="crop").fit_frame(np.zeros((90, 160), np.uint8), (80, 60)).shape
        (60, 80)
    """

    start: float = 0.0
    stop: float = inf
    crop: tuple[int, int, int, int] | None = None
    fit: FitMode = "pad"

    def __post_init__(self) -> None:
        if not 0 <= self.start < self.stop:
            raise ValueError(f"start must be at least 0 and before stop, not {self.start} and {self.stop}")
        whole = self.crop is None or (len(self.crop) == 4 and all(isinstance(n, int) for n in self.crop))
        if not whole or (self.crop is not None and (min(self.crop[:2]) < 0 or min(self.crop[2:]) < 1)):
            raise ValueError(f"crop must be (x, y, width, height) within the frame, not {self.crop}")
        if self.fit not in get_args(FitMode):
            raise ValueError(f"fit must be one of {', '.join(get_args(FitMode))}, not {self.fit!r}")

    def apply(self, frames: Iterator[VideoFrame], size: tuple[int, int] | None = None) -> Iterator[VideoFrame]:
        """Yield the frames of the part, fitted to `size` (width, height) if given. ValueError if there are none."""
        whole, empty = (self.start, self.stop) == (0, inf), True
        first, begin = None, round(self.start * MICROSECONDS)
        for frame in frames:
            time = frame.time
            if not whole:
                first = time if first is None else first
                since = time - first
                if since >= self.stop * MICROSECONDS:
                    break
                if since < begin:
                    continue
                time = since - begin
            empty = False
            yield frame._replace(time=time, pixels=self.fit_frame(frame.pixels, size, frame.levels[0]))
        if empty and not whole:
            raise ValueError(f"the video has no frames from {self.start:g} s to {self.stop:g} s")

    def fit_frame(self, frame: np.ndarray, size: tuple[int, int] | None, black: float = 0) -> np.ndarray:
        """Return the visible part of a frame [H, W] or [H, W, C], fitted to `size` (width, height) if given.

        Args:
            frame: Pixels.
            size: (width, height) in pixels, or None for the size of the part.
            black: Value that "pad" fills with.

        Raises:
            ValueError: `crop` isn't within the frame.
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
            return scale_frame(frame, size)
        if self.fit == "pad":
            scale = min(across, down)
            inner = max(round(width * scale), 1), max(round(height * scale), 1)
            left, top = (size[0] - inner[0]) // 2, (size[1] - inner[1]) // 2
            around = np.full((size[1], size[0], *frame.shape[2:]), black, frame.dtype)
            around[top : top + inner[1], left : left + inner[0]] = scale_frame(frame, inner)
            return around
        scale = max(across, down)
        keep = max(round(size[0] / scale), 1), max(round(size[1] / scale), 1)
        left, top = (width - keep[0]) // 2, (height - keep[1]) // 2
        return scale_frame(frame[top : top + keep[1], left : left + keep[0]], size)


def scale_frame(frame: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Scale a frame [H, W] or [H, W, C] to `size` (width, height)."""
    shrinks = size[0] < frame.shape[1] or size[1] < frame.shape[0]
    how = cv2.INTER_AREA if shrinks else cv2.INTER_LINEAR
    return np.asarray(cv2.resize(np.ascontiguousarray(frame), size, interpolation=how))


WHOLE_VIDEO = VideoView()
