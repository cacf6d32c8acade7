"""Frames and their times, from video files, cameras, image files and arrays."""

from __future__ import annotations

import os
import time
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np

from nvsdata.common.errors import FormatError
from nvsdata.common.prefetch import prefetch
from nvsdata.common.validation import positive
from nvsdata.data.frame_edges import MICROSECONDS
from nvsdata.video.decoder import FULL, Decoder
from nvsdata.video.folder import check_name

Video = str | os.PathLike[str] | int | Iterable[Any]
USUAL_RATE = 30.0  # frames per second where a video has no times of its own


class Frame(NamedTuple):
    """A picture and its time.

    - `time`: µs
    - `pixels`: [H, W] or [H, W, 3]; uint8, or float64 from 0 to 255
    - `red_first`: whether colors are red, green, blue, not blue, green, red (default False)
    - `levels`: the values of black and white in gray bytes (default (0, 255))
    - `whole`: whether the video has it; if not, it was made between two that it has (default True)
    """

    time: int
    pixels: np.ndarray
    red_first: bool = False
    levels: tuple[int, int] = FULL
    whole: bool = True


class TruncatedVideo(FormatError):
    """A video that ended well before the last frame that its container promises."""


def frames_of(
    video: Video,
    *,
    fps: float | None = None,
    times: Iterable[int] | None = None,
    size: tuple[int, int] | None = None,
    color: bool = True,
) -> Iterator[Frame]:
    """Time and picture of each frame; times count from the first frame.

    - `video`, `fps`, `times`, `size`: as `PIX2NVS.stream` takes them
    - `color`: whether colors are needed; if not, a file may give luminance alone, which is faster (default True)

    Raises FileNotFoundError, FormatError for what can't be decoded, `TruncatedVideo` at the end of a file that was cut
    off, and ValueError for wrong parameters and frames.
    """
    if fps is not None:
        positive("fps", fps)
    if size is not None and (len(size) != 2 or min(size) < 1):
        raise ValueError(f"size must be (width, height) in whole pixels, not {size}")
    if fps is not None and times is not None:
        raise ValueError("give fps or times, not both")
    if isinstance(video, str | os.PathLike):
        found = _file(Path(video), size, color)
    elif isinstance(video, int):
        found = _camera(video, size)
    else:
        found = _given(video, size)
    if times is not None:
        return _timed(found, times)
    return found if fps is None else _timed(found, _regular(fps))


def _timed(frames: Iterator[Frame], times: Iterable[int]) -> Iterator[Frame]:
    given = iter(times)
    for n, frame in enumerate(frames):
        moment = next(given, None)
        if moment is None:
            raise ValueError(f"frame {n} has no time: fewer times than frames were given")
        yield frame._replace(time=int(moment))


def _regular(fps: float) -> Iterator[int]:
    n = 0
    while True:
        yield round(n * MICROSECONDS / fps)
        n += 1


def _file(path: Path, size: tuple[int, int] | None, color: bool) -> Iterator[Frame]:
    """A file's frames, decoded ahead in a thread of their own."""
    if not path.exists():
        raise FileNotFoundError(f"{path}: no such video")
    if path.is_dir():
        raise FormatError(path, "is a folder, not a video")
    check_name(path)
    decoder = Decoder(path, color)
    try:
        gap = MICROSECONDS / (decoder.rate or USUAL_RATE)
        count, first, last, longest = 0, 0, 0, gap
        for moment, pixels in prefetch((moment, _scaled(picture, size)) for moment, picture in decoder):
            first = moment if count == 0 else first
            # containers without times report the same time for all frames
            now = moment - first if count == 0 or moment - first > last else last + round(gap)
            yield Frame(now, pixels, levels=decoder.levels)
            longest = max(longest, now - last)
            count, last = count + 1, now
        if count == 0:
            raise FormatError(path, "not one frame can be decoded")
        # by time, because several containers only estimate how many frames they hold, as if they came regularly
        whole = decoder.promised * gap
        if whole - (last + longest) > max(3 * gap, whole / 50):
            raise TruncatedVideo(path, f"ends after {count} of {decoder.promised} frames: cut off or damaged")
    finally:
        decoder.close()


def _camera(number: int, size: tuple[int, int] | None) -> Iterator[Frame]:
    capture = cv2.VideoCapture(number)
    try:
        if not capture.isOpened():
            raise FileNotFoundError(f"no camera {number}")
        start = time.monotonic_ns()
        while True:
            ok, frame = capture.read()
            if not ok:
                return
            yield Frame((time.monotonic_ns() - start) // 1000, _scaled(frame, size))
    finally:
        capture.release()


def _given(frames: Iterable[Any], size: tuple[int, int] | None) -> Iterator[Frame]:
    times = _regular(USUAL_RATE)
    for n, given in enumerate(frames):
        if isinstance(given, Frame):
            yield given._replace(pixels=_scaled(given.pixels, size))
        elif isinstance(given, str | os.PathLike):
            check_name(given)
            frame = cv2.imread(os.fspath(given), cv2.IMREAD_UNCHANGED)
            if frame is None:
                if not Path(given).exists():
                    raise FileNotFoundError(f"{given}: no such image")
                raise FormatError(given, "holds no image that OpenCV can decode")
            yield Frame(next(times), _scaled(_picture(frame, n), size))
        else:
            # a copy, because the caller may write the next frame into the same array
            yield Frame(next(times), _scaled(_picture(np.array(given), n), size), red_first=True)


def _picture(frame: np.ndarray, n: int) -> np.ndarray:
    """A frame as the emulator takes it; ValueError for shapes and types that aren't a picture's."""
    if frame.ndim == 3 and frame.shape[2] == 1:
        frame = frame[..., 0]
    if 0 in frame.shape or not (frame.ndim == 2 or (frame.ndim == 3 and frame.shape[2] in (3, 4))):
        raise ValueError(f"frame {n} has shape {frame.shape}; it must be [H, W], or [H, W, 3] or [H, W, 4]")
    frame = frame[..., :3] if frame.ndim == 3 else frame
    if frame.dtype == np.uint16:
        frame = frame / 257
    elif frame.dtype == bool:
        frame = frame.astype(np.uint8) * np.uint8(255)
    elif frame.dtype.kind == "f":
        if not (np.isfinite(frame).all() and frame.min() >= 0 and frame.max() <= 1):
            raise ValueError(f"frame {n}: floats must lie in [0, 1]")
        frame = frame.astype(np.float64) * 255
    elif frame.dtype != np.uint8:
        raise ValueError(f"frame {n} is {frame.dtype}; it must be uint8, uint16, bool or float")
    return frame


def _scaled(frame: np.ndarray, size: tuple[int, int] | None) -> np.ndarray:
    if size is None or size == (frame.shape[1], frame.shape[0]):
        return np.ascontiguousarray(frame)
    shrinks = size[0] < frame.shape[1] or size[1] < frame.shape[0]
    how = cv2.INTER_AREA if shrinks else cv2.INTER_LINEAR
    return np.asarray(cv2.resize(np.ascontiguousarray(frame), size, interpolation=how))
