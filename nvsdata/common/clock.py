"""The clock of this computer, by which everything is timed."""

from __future__ import annotations

import time


def host_time() -> float:
    """The host's time in µs since an arbitrary moment."""
    return time.perf_counter() * 1e6
