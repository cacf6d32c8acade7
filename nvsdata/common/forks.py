"""Sections of code during which the process must not fork."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from threading import Condition, get_ident

PATIENCE = 5.0  # s; the longest time that a fork waits for threads


class _Gate:
    """Admits threads unless a fork waits, and a fork when no thread is inside."""

    def __init__(self) -> None:
        self.change = Condition()
        self.inside: set[int] = set()
        self.forks = 0


_gate = _Gate()


@contextmanager
def forkless() -> Iterator[None]:
    """While the block runs, no other thread forks this process.

    A forked process has one thread. A lock that another thread held, such as one in FFmpeg, is never released there.
    Blocks must be short, and don't nest.
    """
    gate, me = _gate, get_ident()
    try:
        with gate.change:
            gate.change.wait_for(lambda: not gate.forks)
            gate.inside.add(me)
        yield
    finally:
        with gate.change:
            gate.inside.discard(me)
            gate.change.notify_all()


def _before() -> None:
    me = get_ident()
    with _gate.change:
        _gate.forks += 1
        _gate.change.wait_for(lambda: not _gate.inside - {me}, PATIENCE)


def _in_parent() -> None:
    with _gate.change:
        _gate.forks -= 1
        _gate.change.notify_all()


def _in_child() -> None:
    global _gate
    # its lock may have been another thread's
    _gate = _Gate()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(before=_before, after_in_parent=_in_parent, after_in_child=_in_child)
