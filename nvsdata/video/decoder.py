"""Decoding of video files by OpenCV: to the stored luma alone, if that is enough and the file's format allows it.

Most codecs store luma and chroma. OpenCV converts them to colors, which takes a quarter of its time, and its fast
conversion shifts luminance by up to 2.5 levels of 255. For pixel formats that begin with luma, OpenCV can return luma
alone. Comparison with the colors of the first frame shows which luma values are black and white.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path
from threading import Lock
from typing import Any

import cv2
import numpy as np

from nvsdata.common.errors import FormatError
from nvsdata.common.forks import forkless
from nvsdata.common.prefetch import in_one_thread
from nvsdata.data.frame_edges import MICROSECONDS
from nvsdata.video.video_frame import FULL, STUDIO, VideoFrame, check_name, rgb_luminance, stretch_levels

USUAL_RATE = 30.0  # frames per second where a video has no times of its own
SMALL = 1 << 20  # pixels of the largest frame that one thread decodes
# formats of 8 bits that store all luma before any chroma
LUMA_FIRST = frozenset(
    cv2.VideoWriter.fourcc(*name) for name in ("I420", "IYUV", "YV12", "NV12", "422P", "Y42B", "444P", "Y800", "GREY")
)
COARSE = 3  # gray levels by which OpenCV's colors may be off
LEAST_FRACTION = 0.99  # fraction of pixels that must be off by at most `COARSE`
CONTRAST = 5  # standard deviation, in gray levels, from which the contrast of a frame can be measured


class TruncatedVideo(FormatError):
    """A video that ends well before the last frame that its container promises."""


def decode_video(path: Path, color: bool) -> Iterator[VideoFrame]:
    """Yield the frames of a video file; times are relative to the first frame.

    Args:
        path: A video file.
        color: Whether colors are needed; if not, frames are gray where the file stores luma first, which is faster.

    Raises:
        FileNotFoundError: There is no such file.
        FormatError: OpenCV can't decode it.
        TruncatedVideo: At the end, if frames are missing.
    """
    if not path.exists():
        raise FileNotFoundError(f"{path}: no such video")
    check_name(path)
    with forkless(), quiet():
        reader, pixels, levels = _begin(path, color)
    try:
        gap = MICROSECONDS / (reader.get(cv2.CAP_PROP_FPS) or USUAL_RATE)
        promised = int(reader.get(cv2.CAP_PROP_FRAME_COUNT))
        count, first, last, longest = 0, 0, 0, gap
        with quiet() if levels else nullcontext():
            while pixels is not None:
                stamp = round(reader.get(cv2.CAP_PROP_POS_MSEC) * 1000)
                first = stamp if count == 0 else first
                # containers without times report the same time for all frames
                time = stamp - first if count == 0 or stamp - first > last else last + round(gap)
                yield VideoFrame(time, pixels, levels=levels or FULL)
                count, last, longest = count + 1, time, max(longest, time - last)
                with forkless():
                    pixels = reader.read()[1]
        if count == 0:
            raise FormatError(path, "no frame can be decoded: damaged, or a codec that OpenCV doesn't support")
        # compare durations: several containers only estimate their number of frames from the mean rate
        whole = promised * gap
        if count < promised and whole - (last + longest) > max(3 * gap, whole / 50):
            raise TruncatedVideo(path, f"ends after {count} of {promised} frames: cut off or damaged")
    finally:
        with forkless():
            reader.release()


def _begin(path: Path, color: bool) -> tuple[Any, np.ndarray | None, tuple[int, int] | None]:
    """Return OpenCV's reader, the first frame, and the luma values of black and white; None for frames with colors."""
    reader, options = _opened(path)
    first = reader.read()[1]
    if not color and first is not None and int(reader.get(cv2.CAP_PROP_CODEC_PIXEL_FORMAT)) in LUMA_FIRST:
        other = cv2.VideoCapture(str(path), cv2.CAP_FFMPEG, options)
        other.set(cv2.CAP_PROP_CONVERT_RGB, 0)
        luma = other.read()[1]
        levels = levels_of(luma, first)
        if levels is not None:
            reader.release()
            return other, luma, levels
        other.release()
    return reader, first, None


def length_of(path: Path) -> tuple[int, float]:
    """Return the number of frames and the duration in s that a video's container states; 0 for a missing value."""
    with quiet():
        reader = cv2.VideoCapture(str(path), cv2.CAP_FFMPEG)
        try:
            frames, rate = reader.get(cv2.CAP_PROP_FRAME_COUNT), reader.get(cv2.CAP_PROP_FPS)
        finally:
            reader.release()
    count = int(frames) if frames > 0 else 0
    return count, count / rate if rate > 0 else 0.0


def levels_of(luma: np.ndarray | None, colors: np.ndarray) -> tuple[int, int] | None:
    """Return the luma values of black and white, by comparison of a frame with its colors; None if uncertain.

    Args:
        luma: Stored luma [H, W], or None.
        colors: The same frame in blue, green and red, [H, W, 3].
    """
    if luma is None or luma.shape != colors.shape[:2] or luma.dtype != np.uint8:
        return None
    some = slice(None, None, max(1, min(luma.shape) // 128))
    blue, green, red = np.moveaxis(colors[some, some].astype(np.float64), -1, 0)
    luma, known = luma[some, some], rgb_luminance(red, green, blue)
    meant = {levels: stretch_levels(luma, levels) for levels in (FULL, STUDIO)}
    near = [levels for levels, gray in meant.items() if (abs(gray - known) <= COARSE).mean() >= LEAST_FRACTION]
    if len(near) == 2:
        # near mid-gray both levels give nearly the same values, but not the same contrast
        near = [levels for levels in near if _same_contrast(meant[levels], known)]
    return near[0] if len(near) == 1 else None


def _same_contrast(gray: np.ndarray, known: np.ndarray) -> bool:
    """Return whether both images have the same contrast, and enough of it; wrong levels change it by 16%."""
    spread = gray - gray.mean()
    return bool(gray.std() >= CONTRAST and abs((spread * known).sum() / (spread * spread).sum() - 1) < 0.06)


def _opened(path: Path) -> tuple[Any, list[int]]:
    """Open a video; return OpenCV's reader and the options with which it was opened.

    Small frames are decoded in one thread, because several threads would only wait for each other.
    """
    options = [cv2.CAP_PROP_N_THREADS, 1]
    reader = cv2.VideoCapture(str(path), cv2.CAP_FFMPEG, options)
    pixels = reader.get(cv2.CAP_PROP_FRAME_WIDTH) * reader.get(cv2.CAP_PROP_FRAME_HEIGHT)
    if not reader.isOpened() or (pixels > SMALL and not in_one_thread()):
        options = []
        reader = cv2.VideoCapture(str(path), cv2.CAP_FFMPEG, options)
    if not reader.isOpened():
        raise FormatError(path, "contains no video that OpenCV can decode")
    return reader, options


# OpenCV 5 moved this module, and OpenCV 4 has no names for its levels
logging = getattr(cv2.utils, "logging", cv2)
ERRORS_ONLY = 2
# silences FFmpeg's messages, which don't name the video; nvsdata's errors do. OpenCV reads this with its first video
os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")

_quiet_lock = Lock()
_quiet = {"streams": 0, "level": 0}


@contextmanager
def quiet() -> Iterator[None]:
    """Silence OpenCV's warnings in the entire process while the block runs.

    OpenCV warns about frames of luma in place of colors, which are intended. It also warns about broken files, for
    which nvsdata raises an error that names the file.
    """
    with _quiet_lock:
        if _quiet["streams"] == 0:
            _quiet["level"] = logging.setLogLevel(ERRORS_ONLY)
        _quiet["streams"] += 1
    try:
        yield
    finally:
        with _quiet_lock:
            _quiet["streams"] -= 1
            if _quiet["streams"] == 0:
                logging.setLogLevel(_quiet["level"])
