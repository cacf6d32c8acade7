"""Videos of still images in front of a camera that makes the saccades of N-MNIST and N-Caltech101."""

from __future__ import annotations

from collections.abc import Iterator

import cv2
import numpy as np

from nvsdata.common.validation import positive
from nvsdata.video.video_frame import VideoFrame, as_pixels

# position of the image at the start and after each saccade, in pixels; the datasets' authors undo the same motion to
# stabilize recordings
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
    """Yield the frames of a still image that moves along a path in front of a camera, by fractions of pixels.

    The default path is that of N-MNIST (Orchard et al. 2015): three saccades of 105 ms that return to the start.

    Args:
        still: Gray [h, w] or RGB [h, w, 3], as `PIX2NVS.stream` takes it; the path is centered on the sensor.
        size: (width, height) of the sensor in pixels.
        fps: Frames per second; at 200 the image moves by at most 0.4 pixels per frame.
        path: (x, y) in pixels at the start and after each saccade.
        duration: Duration of each saccade in µs.
        background: Gray level, 0 to 255, around the image.

    Returns:
        An iterator over `VideoFrame`s of uint8.

    Raises:
        ValueError: A setting is out of range, the path has fewer than two points, or `still` isn't an image.

    Example:
        >>> frames = list(saccades(np.full((28, 28), 255, np.uint8)))
        >>> len(frames), frames[0].pixels.shape
        (64, (34, 34))
    """
    positive("fps", fps)
    positive("duration", duration)
    if len(path) < 2:
        raise ValueError(f"a path has at least a beginning and an end, not {path}")
    if min(size) < 1:
        raise ValueError(f"size must be (width, height) in whole pixels, not {size}")
    shown = as_pixels(np.array(still), "the image").astype(np.float32)
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
