"""Frames and their times, from video files, cameras, image files and arrays."""

from __future__ import annotations

import os
import time
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from nvsdata.common.errors import FormatError
from nvsdata.common.prefetch import prefetch
from nvsdata.common.validation import positive
from nvsdata.data.frame_edges import MICROSECONDS
from nvsdata.data.recording import Recording
from nvsdata.video.decoder import Decoder, check_name
from nvsdata.video.picture import Frame, picture
from nvsdata.video.recorded import of_folder, of_recording
from nvsdata.video.view import View

__all__ = ["USUAL_RATE", "Frame", "TruncatedVideo", "Video", "frames_of"]

Video = str | os.PathLike[str] | int | Recording | Iterable[Any]
USUAL_RATE = 30.0  # frames per second where a video has no times of its own


class TruncatedVideo(FormatError):
    """A video that ended well before the last frame that its container promises."""


def frames_of(
    video: Video,
    *,
    fps: float | None = None,
    times: Iterable[int] | None = None,
    size: tuple[int, int] | None = None,
    view: View | None = None,
    color: bool = True,
) -> Iterator[Frame]:
    """Time and picture of each frame; times count from the first frame, those in a camera's own clock stay as they are.

    - `video`, `fps`, `times`, `size`: as `PIX2NVS.stream` takes them
    - `view`: which part of the video, and how frames come into `size` (default: all of it, stretched)
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
    shape = view or View(fit="stretch")
    found: Iterator[Frame]
    if isinstance(video, Recording):
        found = _given(of_recording(video), shape, size)
    elif isinstance(video, str | os.PathLike) and Path(video).is_dir():
        found = _given(of_folder(Path(video)), shape, size)
    elif isinstance(video, str | os.PathLike):
        found = _file(Path(video), size, color, shape)
    elif isinstance(video, int):
        found = _camera(video, shape, size)
    else:
        found = _given(video, shape, size)
    if times is not None:
        found = _timed(found, times)
    elif fps is not None:
        found = _timed(found, _regular(fps))
    return shape.between(found)


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


def _file(path: Path, size: tuple[int, int] | None, color: bool, shape: View) -> Iterator[Frame]:
    """A file's frames, decoded ahead in a thread of their own."""
    if not path.exists():
        raise FileNotFoundError(f"{path}: no such video")
    check_name(path)
    decoder = Decoder(path, color)
    try:
        gap = MICROSECONDS / (decoder.rate or USUAL_RATE)
        count, first, last, longest = 0, 0, 0, gap
        for moment, pixels in prefetch(
            (moment, shape.shaped(picture, size, decoder.levels[0])) for moment, picture in decoder
        ):
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
        if count < decoder.promised and whole - (last + longest) > max(3 * gap, whole / 50):
            raise TruncatedVideo(path, f"ends after {count} of {decoder.promised} frames: cut off or damaged")
    finally:
        decoder.close()


def _camera(number: int, shape: View, size: tuple[int, int] | None) -> Iterator[Frame]:
    capture = cv2.VideoCapture(number)
    try:
        if not capture.isOpened():
            raise FileNotFoundError(f"no camera {number}")
        start = time.monotonic_ns()
        while True:
            ok, frame = capture.read()
            if not ok:
                return
            yield Frame((time.monotonic_ns() - start) // 1000, shape.shaped(frame, size))
    finally:
        capture.release()


def _given(frames: Iterable[Any], shape: View, size: tuple[int, int] | None) -> Iterator[Frame]:
    times = _regular(USUAL_RATE)
    for n, given in enumerate(frames):
        if isinstance(given, Frame):
            yield given._replace(pixels=shape.shaped(given.pixels, size, given.levels[0]))
        elif isinstance(given, str | os.PathLike):
            check_name(given)
            frame = cv2.imread(os.fspath(given), cv2.IMREAD_UNCHANGED)
            if frame is None:
                if not Path(given).exists():
                    raise FileNotFoundError(f"{given}: no such image")
                raise FormatError(given, "holds no image that OpenCV can decode")
            yield Frame(next(times), shape.shaped(picture(frame, f"frame {n}"), size))
        else:
            # a copy, because the caller may write the next frame into the same array
            yield Frame(next(times), shape.shaped(picture(np.array(given), f"frame {n}"), size), red_first=True)
