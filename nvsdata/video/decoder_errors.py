"""How many errors FFmpeg's decoders tell: of a damaged stream they make smeared pictures, and OpenCV says nothing.

FFmpeg tells what it finds to a function of its caller's. OpenCV prints the lines, without a video's name; here they are
counted. The function is called by FFmpeg's threads some five times per frame, so it must not wait for Python's lock: it
is three instructions, made by the compiler that numba brings.
"""

from __future__ import annotations

import ctypes
import os
from functools import cache
from pathlib import Path
from threading import Lock
from typing import ClassVar, Self

import cv2

from nvsdata.video.decoder import quiet

ERROR = 16  # FFmpeg's level of errors; those of worse ones are smaller
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
    found = _counter()
    return 0 if found is None else int(found.value)


@cache
def _counter() -> ctypes.c_int64 | None:
    """The number that FFmpeg counts up; None if its library isn't where OpenCV's wheels have it, or the user wants to
    see its lines.
    """
    home = Path(cv2.__file__).parent
    libraries = [path for pattern in LIBRARIES for path in home.glob(pattern)]
    if not libraries or os.environ.get("OPENCV_FFMPEG_LOGLEVEL") != "-8":
        return None
    with quiet():
        # OpenCV sets its own function with the first video
        cv2.VideoCapture("", cv2.CAP_FFMPEG).release()
    told, count = _compiled()
    try:
        ctypes.CDLL(str(libraries[0])).av_log_set_callback(ctypes.c_void_p(told))
    except (OSError, AttributeError):
        return None
    return ctypes.c_int64.from_address(count)


def _compiled() -> tuple[int, int]:
    """Addresses of told(context, level, text, values), which counts errors, and of the count."""
    from llvmlite import binding, ir

    wide, level = ir.IntType(64), ir.IntType(32)
    module = ir.Module()
    count = ir.GlobalVariable(module, wide, "count")
    count.initializer = wide(0)
    told = ir.Function(module, ir.FunctionType(ir.VoidType(), [wide, level, wide, wide]), "told")
    builder = ir.IRBuilder(told.append_basic_block())
    with builder.if_then(builder.icmp_signed("<=", told.args[1], level(ERROR))):
        builder.atomic_rmw("add", count, wide(1), "monotonic")
    builder.ret_void()
    binding.initialize_native_target()
    binding.initialize_native_asmprinter()
    machine = binding.Target.from_default_triple().create_target_machine()
    engine = binding.create_mcjit_compiler(binding.parse_assembly(str(module)), machine)
    engine.finalize_object()
    found = engine.get_function_address("told"), engine.get_global_value_address("count")
    # FFmpeg may call it as long as the process lasts
    engine.detach()
    return found
