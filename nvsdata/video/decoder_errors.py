"""How many errors FFmpeg's decoders tell: of a damaged stream they make smeared pictures, and OpenCV says nothing.

FFmpeg tells what it finds to a function of its caller's. OpenCV prints the lines, without a video's name; here they are
counted by a compiled function, because FFmpeg's threads call it some five times per frame.
"""

from __future__ import annotations

import ctypes
import os
from functools import cache
from pathlib import Path
from threading import Lock
from typing import ClassVar, Self

import cv2

from nvsdata.kernels import _native
from nvsdata.video.decoder import quiet

# of OpenCV's wheels for Linux and macOS; the one for Windows has FFmpeg within another library, without this function
LIBRARIES = "../opencv*.libs/libavutil*", ".dylibs/libavutil*"


class DecoderErrors:
    """In a `with` block that decodes one video: how many errors its decoder told; `found` has them afterwards.

    FFmpeg doesn't say which video they are of. If the block ran at the same time as another, in another thread, or if
    errors can't be had at all, `found` is 0.
    """

    found = 0
    _open: ClassVar[list[DecoderErrors]] = []
    _lock: ClassVar[Lock] = Lock()
    _alone = True

    def __enter__(self) -> Self:
        with self._lock:
            self._open.append(self)
            if len(self._open) > 1:
                for block in self._open:
                    block._alone = False
        self._before = decoder_errors()
        return self

    def __exit__(self, *_: object) -> None:
        found = decoder_errors() - self._before
        with self._lock:
            self._open.remove(self)
            self.found = found if self._alone else 0


def decoder_errors() -> int:
    """The errors that decoders of this process told since this was first called; always 0 where they can't be had."""
    return _native.counted_errors() if _counts() else 0


@cache
def _counts() -> bool:
    """Make FFmpeg call a function that counts; False if its library isn't where OpenCV's wheels have it, or the user
    wants to see its lines.
    """
    home = Path(cv2.__file__).parent
    libraries = [path for pattern in LIBRARIES for path in home.glob(pattern)]
    if not libraries or os.environ.get("OPENCV_FFMPEG_LOGLEVEL") != "-8":
        return False
    with quiet():
        # OpenCV sets its own function with the first video
        cv2.VideoCapture("", cv2.CAP_FFMPEG).release()
    try:
        ctypes.CDLL(str(libraries[0])).av_log_set_callback(ctypes.c_void_p(_native.error_counter()))
    except (OSError, AttributeError):
        return False
    return True
