"""Processes that end with this one, and the number of usable cores."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable
from contextlib import suppress
from multiprocessing import Pipe, get_all_start_methods, get_context, parent_process
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from pathlib import Path
from threading import Thread
from typing import Any


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


def connected_process(
    target: Callable[[Connection, Any], None], given: Any, module: str
) -> tuple[BaseProcess, Connection]:
    """Start a process that calls `target` with a connection and `given`; return it and the connection's other end.

    The process ends when this one does, even if this one is killed. Forking a process that has threads (such as
    torch's) may hang. So the process is forked from a server process that has only imported `module`; starting the
    server takes a second. On systems without a fork server, the process imports `module`.

    Args:
        target: function that the process calls.
        given: what it is called with.
        module: name of the module that is imported before the first process is forked.
    """
    method = "forkserver" if "forkserver" in get_all_start_methods() else "spawn"
    context: Any = get_context(method)
    if method == "forkserver":
        context.set_forkserver_preload([module])
        _start_server()
    own, its = Pipe()
    process = context.Process(target=_begin, args=(target, its, given), daemon=True)
    try:
        process.start()
    finally:
        # the only one is then in the process, so `own` shows when it has ended
        its.close()
    return process, own


def _start_server() -> None:
    """Start the fork server with Ctrl-C blocked, as its processes inherit: none ends with a traceback while it imports.

    This process, which handles Ctrl-C, ends them.
    """
    # not on Windows
    from multiprocessing import forkserver, resource_tracker

    # the server starts it, too, and then Ctrl-C would no longer be blocked
    resource_tracker.ensure_running()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        forkserver.ensure_running()
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _begin(target: Callable[[Connection, Any], None], connection: Connection, given: Any) -> None:
    end_with_parent()
    target(connection, given)


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
