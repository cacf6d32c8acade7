"""Videos of still pictures, seen by a camera that moves as it did for N-MNIST and N-Caltech101."""

from __future__ import annotations

from collections.abc import Iterator

import cv2
import numpy as np

from nvsdata.common.validation import positive
from nvsdata.video.video_frame import VideoFrame, as_pixels

# where the picture is at first and after each saccade, in pixels; the dataset's authors undo the same
PATH = ((0.0, 0.0), (3.5, 7.0), (7.0, 0.0), (0.0, 0.0))
SACCADE = 105_000  # µs


def saccades(
    still: np.ndarray,
    size: tuple[int, int] = (34, 34),
    *,
    fps: float = 200.0,
    path: tuple[tuple[float, float], ...] = PATH,
    duration: int = SACCADE,
    background: float = 0.0,
) -> Iterator[VideoFrame]:
    """Frames of a still picture that moves along a path before a camera, in fractions of pixels.

    The default path is that of N-MNIST (Orchard et al. 2015): three saccades of 105 ms that return to where they began.

    - `still`: gray [h, w] or RGB [h, w, 3], as `PIX2NVS.stream` takes it; in the middle of what it covers on its way
    - `size`: (width, height) of the sensor in pixels (default 34x34)
    - `fps`: frames per second (default 200: at most 0.4 pixels from one to the next)
    - `path`: (x, y) in pixels at the beginning and after each saccade
    - `duration`: µs of each saccade (default 105,000)
    - `background`: gray level, 0 to 255, of what surrounds the picture (default 0)

    Raises ValueError for settings out of range, a path without a saccade, and what isn't a picture.
    """
    positive("fps", fps)
    positive("duration", duration)
    if len(path) < 2:
        raise ValueError(f"a path has at least a beginning and an end, not {path}")
    if min(size) < 1:
        raise ValueError(f"size must be (width, height) in whole pixels, not {size}")
    shown = as_pixels(np.array(still), "the picture").astype(np.float32)
    corners = np.array(path)
    middle = (np.array(size) - shown.shape[1::-1] - corners.min(axis=0) - corners.max(axis=0)) / 2
    return _frames(shown, size, fps, corners + middle, duration, background)


def _frames(
    shown: np.ndarray, size: tuple[int, int], fps: float, corners: np.ndarray, duration: int, background: float
) -> Iterator[VideoFrame]:
    end = duration * (len(corners) - 1)
    edges = np.arange(len(corners)) * duration
    value = (background,) * 3
    n = 0
    while (time := round(n * 1e6 / fps)) <= end:
        x, y = (float(np.interp(time, edges, axis)) for axis in corners.T)
        where = np.array([[1, 0, x], [0, 1, y]], np.float32)
        moved = cv2.warpAffine(shown, where, size, flags=cv2.INTER_LINEAR, borderValue=value)
        yield VideoFrame(time, np.rint(moved).astype(np.uint8), red_first=True)
        n += 1
