"""Processes that work side by side."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_all_start_methods, get_context


def pool(count: int, module: str, prepare: Callable[[], None] | None = None) -> ProcessPoolExecutor:
    """`count` processes, each of which calls `prepare` first.

    Forking a process that has threads (torch's, numba's) may hang. They are forked off one that has only
    imported `module`, which takes a second once; where the system can't, each imports it anew.
    """
    method = "forkserver" if "forkserver" in get_all_start_methods() else "spawn"
    context = get_context(method)
    if method == "forkserver":
        context.set_forkserver_preload([module])
    return ProcessPoolExecutor(count, mp_context=context, initializer=prepare)
