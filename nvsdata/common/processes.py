"""Pools of processes that end with this one, and the number of usable cores."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from contextlib import suppress
from functools import partial
from multiprocessing import get_all_start_methods, get_context, parent_process
from multiprocessing.connection import wait
from pathlib import Path
from threading import Thread


def cores() -> int:
    """Return the number of cores that this process may use, by its affinity and the quota of its control group."""
    try:
        count = len(os.sched_getaffinity(0))
    except AttributeError:  # not on macOS and Windows
        count = os.cpu_count() or 1
    with suppress(OSError, ValueError):
        quota, period = Path("/sys/fs/cgroup/cpu.max").read_text().split()
        count = min(count, max(1, round(int(quota) / int(period))))
    return count


def process_pool(count: int, module: str, prepare: Callable[[], None] | None = None) -> ProcessPoolExecutor:
    """Return a pool of processes that end when this process does, even if it is killed.

    Forking a process that has threads (such as torch's) may hang. So the processes are forked from a server process
    that has only imported `module`; starting the server takes a second. On systems without a fork server, each process
    imports `module`.

    Args:
        count: number of processes.
        module: name of the module that is imported before the processes are forked.
        prepare: function that each process calls first (default None).
    """
    method = "forkserver" if "forkserver" in get_all_start_methods() else "spawn"
    context = get_context(method)
    if method == "forkserver":
        context.set_forkserver_preload([module])
    return ProcessPoolExecutor(count, mp_context=context, initializer=partial(_begin, prepare))


def _begin(prepare: Callable[[], None] | None) -> None:
    end_with_parent()
    if prepare is not None:
        prepare()


def end_with_parent() -> None:
    """Make this child process of multiprocessing end as soon as its parent has ended."""
    parent = parent_process()
    if parent is None:
        return

    def watch() -> None:
        wait([parent.sentinel])
        # nobody needs this process's result now; the next run removes the files that it was writing
        os._exit(1)

    Thread(target=watch, name="nvsdata-parent", daemon=True).start()
