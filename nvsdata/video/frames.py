"""Frames of video files, cameras, folders of images, recordings and arrays, all by the function `frames_of`."""

from __future__ import annotations

import os
import time
from collections.abc import Iterable, Iterator
from itertools import count
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from nvsdata.common.prefetch import prefetch
from nvsdata.common.validation import positive
from nvsdata.data.frame_edges import MICROSECONDS
from nvsdata.data.recording import Recording
from nvsdata.video.decoder import USUAL_RATE, TruncatedVideo, decode_video
from nvsdata.video.recorded import read_folder, read_recording
from nvsdata.video.video_frame import VideoFrame, as_pixels, read_image
from nvsdata.video.view import VideoView

__all__ = ["TruncatedVideo", "VideoFrame", "VideoInput", "frames_of", "regular_times"]

VideoInput = str | os.PathLike[str] | int | Recording | Iterable[Any]


def frames_of(
    video: VideoInput,
    *,
    fps: float | None = None,
    times: Iterable[int] | None = None,
    size: tuple[int, int] | None = None,
    view: VideoView | None = None,
    color: bool = True,
) -> Iterator[VideoFrame]:
    """Yield the frames of a video.

    Times of video files, cameras and arrays are relative to the first frame. Recordings, folders of images and
    `VideoFrame`s keep their own times.

    Args:
        video: A video file, a folder of images with a list of their times, a camera's number, a recording that has
            frames, or an iterable of `VideoFrame`s, arrays or image files; `PIX2NVS.stream` describes each.
        fps: Frames per second, in place of the video's own times.
        times: Times of the frames in µs, in place of the video's own.
        size: (width, height) in pixels that frames are scaled to (default: unchanged).
        view: Part of the video, and how frames are fitted to `size` (default: all of it, stretched).
        color: Whether colors are needed; if not, frames of a file may be luma alone, which is faster.

    Raises:
        FileNotFoundError: There is no such video.
        FormatError: The video can't be decoded.
        TruncatedVideo: At the end of a file that was cut off.
        ValueError: Parameters or frames are wrong.

    Example:
        >>> frames = frames_of(np.zeros((3, 48, 64), np.uint8), fps=25)
        >>> [frame.time for frame in frames]
        [0, 40000, 80000]
    """
    if fps is not None:
        positive("fps", fps)
    if size is not None and (len(size) != 2 or min(size) < 1):
        raise ValueError(f"size must be (width, height) in whole pixels, not {size}")
    if fps is not None and times is not None:
        raise ValueError("give fps or times, not both")
    is_file = False
    if isinstance(video, str | os.PathLike):
        path = Path(video)
        is_file = not path.is_dir()
        found = decode_video(path, color) if is_file else read_folder(path)
    elif isinstance(video, Recording):
        found = read_recording(video)
    else:
        found = _from_camera(video) if isinstance(video, int) else _from_arrays(video)
    if fps is not None:
        times = regular_times(fps)
    if times is not None:
        found = _at(times, found)
    shown = (view or VideoView(fit="stretch")).apply(found, size)
    # a file is decoded and scaled ahead, in a separate thread
    return prefetch(shown) if is_file else shown


def regular_times(fps: float, first: int = 0) -> Iterator[int]:
    """Return an endless iterator over the times in µs of frames from number `first` on, at `fps` frames per second.

    Example:
        >>> times = regular_times(25)
        >>> next(times), next(times)
        (0, 40000)
    """
    return (round(n * MICROSECONDS / fps) for n in count(first))


def _at(times: Iterable[int], frames: Iterator[VideoFrame]) -> Iterator[VideoFrame]:
    """Yield the frames with `times` (µs) in place of their own. ValueError if there are fewer times than frames."""
    given = iter(times)
    for n, frame in enumerate(frames):
        moment = next(given, None)
        if moment is None:
            raise ValueError(f"frame {n} has no time: fewer times than frames were given")
        yield frame._replace(time=int(moment))


def _from_camera(number: int) -> Iterator[VideoFrame]:
    """Yield the frames of the camera that has this number in OpenCV, with the times at which they arrive."""
    capture = cv2.VideoCapture(number)
    try:
        if not capture.isOpened():
            raise FileNotFoundError(f"OpenCV finds no camera with the number {number}")
        start = time.monotonic_ns()
        while True:
            ok, pixels = capture.read()
            if not ok:
                return
            yield VideoFrame((time.monotonic_ns() - start) // 1000, pixels)
    finally:
        capture.release()


def _from_arrays(frames: Iterable[Any]) -> Iterator[VideoFrame]:
    """Yield frames made of arrays and image files; `VideoFrame`s are yielded unchanged."""
    times = regular_times(USUAL_RATE)
    for n, given in enumerate(frames):
        if isinstance(given, VideoFrame):
            yield given
        elif isinstance(given, str | os.PathLike):
            yield VideoFrame(next(times), read_image(given, f"frame {n}"))
        else:
            # a copy, because the caller may write the next frame into the same array
            yield VideoFrame(next(times), as_pixels(np.array(given), f"frame {n}"), red_first=True)
