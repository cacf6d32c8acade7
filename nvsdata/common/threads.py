"""Threads that end with a block."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from threading import Event, Thread


@contextmanager
def during_block(work: Callable[[Event], None], name: str, patience: float | None = None) -> Iterator[None]:
    """Run `work` in a thread while the block runs.

    Args:
        work: Function of a `threading.Event`, which is set when the block ends; `work` must return soon after that.
        name: Name of the thread.
        patience: Longest time in s to wait for `work` to return (default: unlimited).
    """
    ended = Event()
    # a daemon, because the process must end even if `work` hangs
    thread = Thread(target=work, args=(ended,), name=name, daemon=True)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join(patience)
