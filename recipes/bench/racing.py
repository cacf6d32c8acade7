"""Runs that take turns, so that a slow phase of the machine affects all of them."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from typing import Any

ROUNDS = 7


def race(
    runs: dict[str, Callable[[], Any]], *, inner: int = 1, before: Callable[[], Any] = lambda: None
) -> dict[str, float]:
    """Median seconds per call of each run over rounds of `inner` calls; `before` precedes each round, not timed."""
    times: dict[str, list[float]] = {name: [] for name in runs}
    for run in runs.values():
        run()
    for _ in range(ROUNDS):
        for name, run in runs.items():
            before()
            start = time.perf_counter()
            for _ in range(inner):
                run()
            times[name].append((time.perf_counter() - start) / inner)
    return {name: statistics.median(spent) for name, spent in times.items()}
