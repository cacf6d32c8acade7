"""Arrays as large as a sensor: an error says what is missing, before the system ends the process."""

from __future__ import annotations

import math
import os
import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

LARGE = 1 << 30  # bytes; smaller arrays aren't compared with what is free, which takes longer than to allocate them
UNKNOWN = 1 << 46  # bytes, more than a process can address


def zeros(size: tuple[int, int], shape: Sequence[int], dtype: npt.DTypeLike = np.float32, fill: Any = 0) -> Any:
    """An array for a sensor of `size` (width, height), filled with a number; MemoryError as `check_memory` has it."""
    make = (lambda: np.full(shape, fill, dtype)) if fill else (lambda: np.zeros(shape, dtype))
    return allocated(size, shape, dtype, make)


def allocated(size: tuple[int, int], shape: Sequence[int], dtype: npt.DTypeLike, make: Callable[[], Any]) -> Any:
    """`make()`, which allocates an array of this shape; MemoryError as `check_memory` has it."""
    check_memory(size, shape, dtype)
    try:
        return make()
    except MemoryError:
        raise _missing(size, shape, dtype, "which the system refused") from None


def check_memory(size: tuple[int, int], shape: Sequence[int], dtype: npt.DTypeLike = np.float32) -> None:
    """MemoryError that names the sensor (width, height) if less memory is free than an array of this shape takes."""
    count = bytes_of(shape, dtype)
    if count >= LARGE and count > (free := free_memory()):
        raise _missing(size, shape, dtype, f"and {free / 1e9:.3g} GB are free")


def bytes_of(shape: Sequence[int], dtype: npt.DTypeLike) -> int:
    """Number of bytes of an array."""
    return math.prod(shape) * np.dtype(dtype).itemsize


def free_memory() -> int:
    """Number of bytes that this process may still allocate, as far as the system says."""
    found = [UNKNOWN]
    try:
        found.append(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"))
        known = re.search(r"MemAvailable: *(\d+) kB", Path("/proc/meminfo").read_text())
        if known:
            found.append(int(known[1]) << 10)
        # of a container
        limit, used, stat = (
            Path("/sys/fs/cgroup", f"memory.{name}").read_text() for name in ("max", "current", "stat")
        )
        # pages of files are given up for others
        files = re.findall(r"^(?:in)?active_file (\d+)$", stat, re.MULTILINE)
        found.append(int(limit) - int(used) + sum(map(int, files)))
    except (AttributeError, OSError, ValueError):
        # not Linux, or no limit
        pass
    return min(found)


def _missing(size: tuple[int, int], shape: Sequence[int], dtype: npt.DTypeLike, why: str) -> MemoryError:
    width, height = size
    array = f"an array of shape {list(shape)} {np.dtype(dtype)}"
    what = f"{width}x{height} pixels need {array}, {bytes_of(shape, dtype) / 1e9:.3g} GB, {why}"
    return MemoryError(f"{what}: crop or downsample first (T.Crop, T.Downsample), or state the right sensor_size")
