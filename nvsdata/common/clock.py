"""The clock of this computer that everything is timed by."""

from __future__ import annotations

import time


def host_time() -> float:
    """The host's time in µs, from an arbitrary moment on."""
    return time.perf_counter() * 1e6
