"""Time and memory of calls."""

from __future__ import annotations

import ctypes
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

from nvsdata.benchmarks.case import PreparedCase

STATUS = Path("/proc/self/status")
RESET = Path("/proc/self/clear_refs")


def time_calls(ready: PreparedCase, calls: int) -> list[float]:
    """Return the time of each of several calls in s."""
    found = []
    for _ in range(calls):
        if ready.before is not None:
            ready.before()
        start = time.perf_counter()
        ready.run()
        found.append(time.perf_counter() - start)
    return found


def peak_memory(run: Callable[[], Any], device: str = "cpu") -> int | None:
    """Return the peak increase of the memory of the process during a call.

    Memory that is still allocated from earlier calls doesn't count. Memory that the C library has cached is released
    first.

    Args:
        run: Function that is called.
        device: "cpu" (default), or a GPU, whose memory is measured as torch reports it.

    Returns:
        Bytes, or None where the system doesn't report them (only Linux does).
    """
    if device != "cpu":
        import torch

        torch.cuda.reset_peak_memory_stats()
        before = torch.cuda.memory_allocated()
        run()
        return torch.cuda.max_memory_allocated() - before
    with suppress(OSError, AttributeError):
        ctypes.CDLL("libc.so.6").malloc_trim(0)
    try:
        RESET.write_text("5")
        before = resident_memory("VmRSS")
    except OSError:
        run()
        return None
    run()
    return max(resident_memory("VmHWM") - before, 0)


def resident_memory(name: str) -> int:
    """Return the memory of the process in bytes: now (`VmRSS`) or at its peak (`VmHWM`), as Linux names them."""
    for line in STATUS.read_text().splitlines():
        if line.startswith(f"{name}:"):
            return int(line.split()[1]) * 1024
    return 0
