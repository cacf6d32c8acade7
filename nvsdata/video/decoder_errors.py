"""Counter of errors that FFmpeg's decoders report.

FFmpeg decodes a damaged stream to smeared frames, and OpenCV reports nothing. FFmpeg calls a function for each
message. OpenCV's function prints messages without the video's name; nvsdata's function counts errors. It is compiled,
because FFmpeg's threads call it about five times per frame.
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

# FFmpeg's library in OpenCV's wheels for Linux and macOS; the wheel for Windows has FFmpeg in a library that doesn't
# export `av_log_set_callback`
LIBRARIES = "../opencv*.libs/libavutil*", ".dylibs/libavutil*"


class DecoderErrors:
    """Counter of the decoder errors of one video, for a `with` block; `found` has their number afterwards.

    FFmpeg doesn't name the video of an error. If another thread ran such a block at the same time, or if errors can't
    be counted here, `found` is 0.

    Example:
        >>> with DecoderErrors() as errors:
        ...     pass
        >>> errors.found
        0
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
    """Return the number of errors of this process's decoders since the first call; 0 if they can't be counted."""
    return _native.counted_errors() if _counts() else 0


@cache
def _counts() -> bool:
    """Make FFmpeg call the function that counts errors; return whether that was possible.

    It isn't possible if FFmpeg's library isn't where OpenCV's wheels have it, or if the user set FFmpeg's log level.
    """
    home = Path(cv2.__file__).parent
    libraries = [path for pattern in LIBRARIES for path in home.glob(pattern)]
    if not libraries or os.environ.get("OPENCV_FFMPEG_LOGLEVEL") != "-8":
        return False
    with quiet():
        # with its first video, OpenCV sets its own function, which would replace this one
        cv2.VideoCapture("", cv2.CAP_FFMPEG).release()
    try:
        ctypes.CDLL(str(libraries[0])).av_log_set_callback(ctypes.c_void_p(_native.error_counter()))
    except (OSError, AttributeError):
        return False
    return True
