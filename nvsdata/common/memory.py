"""Memory: checks before large arrays are allocated, and arrays that processes share."""

from __future__ import annotations

import math
import mmap
import os
import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    import torch

LARGE = 1 << 30  # bytes; for smaller arrays, asking for the free memory takes longer than the allocation
UNKNOWN = 1 << 46  # bytes, more than a process can address


def zeros(size: tuple[int, int], shape: Sequence[int], dtype: npt.DTypeLike = np.float32, fill: Any = 0) -> Any:
    """Return an array filled with one value; MemoryError if it takes more memory than is free.

    Args:
        size: (width, height) of the sensor in pixels, for the error message.
        shape: shape of the array.
        dtype: type of the array.
        fill: the value.
    """
    make = (lambda: np.full(shape, fill, dtype)) if fill else (lambda: np.zeros(shape, dtype))
    return allocated(size, shape, dtype, make)


def allocated(size: tuple[int, int], shape: Sequence[int], dtype: npt.DTypeLike, make: Callable[[], Any]) -> Any:
    """Return the array of this shape that `make()` allocates; MemoryError if it takes more memory than is free."""
    check_memory(size, shape, dtype)
    try:
        return make()
    except MemoryError:
        raise _missing(size, shape, dtype, "which the system refused") from None


def check_memory(size: tuple[int, int], shape: Sequence[int], dtype: npt.DTypeLike = np.float32) -> None:
    """Raise MemoryError, which names the sensor size (width, height), if an array takes more memory than is free."""
    count = array_bytes(shape, dtype)
    if count >= LARGE and count > (free := free_memory()):
        raise _missing(size, shape, dtype, f"and {free / 1e9:.3g} GB are free")


def array_bytes(shape: Sequence[int], dtype: npt.DTypeLike) -> int:
    """Return the number of bytes of an array."""
    return math.prod(shape) * np.dtype(dtype).itemsize


def free_memory() -> int:
    """Return the number of bytes that this process may still allocate, as far as the system reports it."""
    found = [UNKNOWN]
    try:
        found.append(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"))
        known = re.search(r"MemAvailable: *(\d+) kB", Path("/proc/meminfo").read_text())
        if known:
            found.append(int(known[1]) << 10)
        # a container may have a lower limit
        limit, used, stat = (
            Path("/sys/fs/cgroup", f"memory.{name}").read_text() for name in ("max", "current", "stat")
        )
        # the system frees cached pages of files when memory is needed
        files = re.findall(r"^(?:in)?active_file (\d+)$", stat, re.MULTILINE)
        found.append(int(limit) - int(used) + sum(map(int, files)))
    except (AttributeError, OSError, ValueError):
        # not Linux, or no limit
        pass
    return min(found)


def _missing(size: tuple[int, int], shape: Sequence[int], dtype: npt.DTypeLike, why: str) -> MemoryError:
    width, height = size
    array = f"an array of shape {list(shape)} {np.dtype(dtype)}"
    what = f"{width}x{height} pixels need {array}, {array_bytes(shape, dtype) / 1e9:.3g} GB, {why}"
    return MemoryError(f"{what}: crop or downsample first (T.Crop, T.Downsample), or state the right sensor_size")


class SharedArray:
    """Array of zeros in memory that is shared with processes that are forked or spawned later.

    The memory is an anonymous mapping, which needs no file descriptor (a process may have about a thousand). When the
    array is sent to a spawned process, it moves to torch's shared memory, which needs a descriptor.

    Args:
        count: number of values.
        dtype: type of the values.

    Attributes:
        values: the array, [count].
    """

    def __init__(self, count: int, dtype: Any) -> None:
        memory = mmap.mmap(-1, max(count * np.dtype(dtype).itemsize, 1))
        self.values: np.ndarray = np.frombuffer(memory, dtype, count)
        self._sent: torch.Tensor | None = None

    def __getstate__(self) -> torch.Tensor:
        if self._sent is None:
            import torch

            self._sent = torch.from_numpy(self.values.copy()).share_memory_()  # type: ignore[no-untyped-call]
            self.values = self._sent.numpy()
        return self._sent

    def __setstate__(self, sent: torch.Tensor) -> None:
        self._sent, self.values = sent, sent.numpy()
