"""Time and memory of calls."""

from __future__ import annotations

import ctypes
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

from nvsdata.benchmarks.case import Ready

STATUS = Path("/proc/self/status")
RESET = Path("/proc/self/clear_refs")


def spent(ready: Ready, calls: int) -> list[float]:
    """Seconds of each of some calls."""
    found = []
    for _ in range(calls):
        if ready.before is not None:
            ready.before()
        start = time.perf_counter()
        ready.run()
        found.append(time.perf_counter() - start)
    return found


def peak_of(run: Callable[[], Any], device: str = "cpu") -> int | None:
    """Bytes by which a call raises what the process holds in memory, or what torch holds in that of another device.

    None where the system doesn't tell (not Linux). Memory that is kept from earlier calls doesn't count; what the C
    library keeps is given back first.
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
        before = resident("VmRSS")
    except OSError:
        run()
        return None
    run()
    return max(resident("VmHWM") - before, 0)


def resident(name: str) -> int:
    """Bytes by a line of the process' status: `VmRSS` are in memory now, `VmHWM` were at most."""
    for line in STATUS.read_text().splitlines():
        if line.startswith(f"{name}:"):
            return int(line.split()[1]) * 1024
    return 0
