"""OpenCV's reader of video files, asked for the stored luminance where a file has it.

Most codecs store luma and chroma. OpenCV turns them into colors, which takes a quarter of its time; its fast
and coarse conversion shifts luminance by up to 2.5 levels of 255. It can hand out luma alone, for pixel formats
that begin with it; which of its values are black and white is found from the first picture.
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

SMALL = 1 << 20  # pixels of the largest frame that one thread decodes
FULL, STUDIO = (0, 255), (16, 235)  # values of black and white
# formats of 8 bits that hold all luma before any chroma
LUMA_FIRST = frozenset(
    cv2.VideoWriter.fourcc(*name) for name in ("I420", "IYUV", "YV12", "NV12", "422P", "Y42B", "444P", "Y800", "GREY")
)
COARSE = 3  # levels by which colors may be off
LEAST_SHARE = 0.99  # of pixels that may not be further off
CONTRAST = 5  # standard deviation, in levels, from which a picture's contrast can be measured


class Decoder:
    """A video file's frames, [H, W, 3] of blue, green and red, or, where possible, [H, W] if not `color`.

    `levels` are the values of black and white, `rate` the frames per second and `promised` the number of frames that
    the file states. FormatError if OpenCV can't decode the file.
    """

    def __init__(self, path: Path, color: bool) -> None:
        self.levels, self._luma = FULL, False
        with forkless(), quiet():
            self._open(path, color)

    def _open(self, path: Path, color: bool) -> None:
        self._reader, options = _opened(path)
        self.rate = float(self._reader.get(cv2.CAP_PROP_FPS))
        self.promised = int(self._reader.get(cv2.CAP_PROP_FRAME_COUNT))
        self._first = self._reader.read()[1]
        if not color and self._first is not None and self._pixel_format() in LUMA_FIRST:
            self._prefer_luma(cv2.VideoCapture(str(path), cv2.CAP_FFMPEG, options))

    def __iter__(self) -> Iterator[tuple[int, np.ndarray]]:
        """Time in µs and picture of each frame; a decoder can be iterated once."""
        frame, self._first = self._first, None
        with quiet() if self._luma else nullcontext():
            while frame is not None:
                yield round(self._reader.get(cv2.CAP_PROP_POS_MSEC) * 1000), frame
                with forkless():
                    frame = self._reader.read()[1]

    def close(self) -> None:
        """Close the file."""
        with forkless():
            self._reader.release()

    def _pixel_format(self) -> int:
        return int(self._reader.get(cv2.CAP_PROP_CODEC_PIXEL_FORMAT))

    def _prefer_luma(self, other: Any) -> None:
        """Read luma by the `other` reader of the file from now on, if its values of black and white are certain."""
        with quiet():
            other.set(cv2.CAP_PROP_CONVERT_RGB, 0)
            luma = other.read()[1]
        levels = levels_of(luma, self._first)
        if levels is not None:
            other, self._reader = self._reader, other
            self._first, self.levels, self._luma = luma, levels, True
        other.release()


def levels_of(luma: np.ndarray | None, colors: np.ndarray) -> tuple[int, int] | None:
    """Values of black and white in the luma of a picture whose colors, blue first, are known; None if in doubt."""
    if luma is None or luma.shape != colors.shape[:2] or luma.dtype != np.uint8:
        return None
    some = slice(None, None, max(1, min(luma.shape) // 128))
    blue, green, red = np.moveaxis(colors[some, some].astype(np.float64), -1, 0)
    luma, known = luma[some, some], luminance(red, green, blue)
    meant = {levels: stretched(luma, levels) for levels in (FULL, STUDIO)}
    near = [levels for levels, gray in meant.items() if (abs(gray - known) <= COARSE).mean() >= LEAST_SHARE]
    if len(near) == 2:
        # all pixels are near mid-gray, where both levels give nearly the same values, but not the same contrast
        near = [levels for levels in near if _as_steep(meant[levels], known)]
    return near[0] if len(near) == 1 else None


def _as_steep(gray: np.ndarray, known: np.ndarray) -> bool:
    """Whether there is contrast, and the same in both pictures: by the other levels it differs by 0.16."""
    spread = gray - gray.mean()
    return bool(gray.std() >= CONTRAST and abs((spread * known).sum() / (spread * spread).sum() - 1) < 0.06)


def luminance(r: np.ndarray, g: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Luminance q of colors (3.2.1), float64."""
    return np.asarray((299 * r + 587 * g + 114 * b) / 1000)


def stretched(luma: np.ndarray, levels: tuple[int, int]) -> np.ndarray:
    """Brightness, float64 from 0 to 255, of luma whose black and white have these values."""
    black, white = levels
    return np.clip((luma.astype(np.float64) - black) * 255 / (white - black), 0, 255)


def _opened(path: Path) -> tuple[Any, list[int]]:
    """OpenCV's reader, and its options: one thread for small frames, because several would only wait for each other."""
    options = [cv2.CAP_PROP_N_THREADS, 1]
    reader = cv2.VideoCapture(str(path), cv2.CAP_FFMPEG, options)
    pixels = reader.get(cv2.CAP_PROP_FRAME_WIDTH) * reader.get(cv2.CAP_PROP_FRAME_HEIGHT)
    if not reader.isOpened() or (pixels > SMALL and not in_one_thread()):
        options = []
        reader = cv2.VideoCapture(str(path), cv2.CAP_FFMPEG, options)
    if not reader.isOpened():
        raise FormatError(path, "holds no video that OpenCV can decode")
    return reader, options


# OpenCV 5 moved it, and 4 doesn't name its levels
logging = getattr(cv2.utils, "logging", cv2)
ERRORS_ONLY = 2
# FFmpeg's own lines don't name the video; our errors do. Read when OpenCV opens its first video
os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")

_quiet_lock = Lock()
_quiet = {"streams": 0, "level": 0}


@contextmanager
def quiet() -> Iterator[None]:
    """Silence OpenCV's warnings: that a frame of luma isn't color, and that a broken file can't be opened, which the
    error says anyway and with its name. The level is set for the whole process.
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


def check_name(path: str | os.PathLike[str]) -> None:
    """FormatError for a name that isn't UTF-8: OpenCV would end the process in a crash."""
    try:
        os.fspath(path).encode()
    except UnicodeEncodeError:
        raise FormatError(path, "a name that isn't UTF-8, which OpenCV can't open: rename the file") from None
