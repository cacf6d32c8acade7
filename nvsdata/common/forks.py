"""Sections of code during which the process must not fork."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from threading import Condition, get_ident

PATIENCE = 5.0  # s; the longest time that a fork waits for threads


class _Gate:
    """State of `forkless`: the threads that are in such a block, and the number of forks that wait for them."""

    def __init__(self) -> None:
        self.change = Condition()
        self.inside: set[int] = set()
        self.forks = 0


_gate = _Gate()


@contextmanager
def forkless() -> Iterator[None]:
    """Keep other threads from forking this process while the block runs, for at most `PATIENCE` seconds.

    A forked process has one thread. A lock that another thread held, such as one in FFmpeg, is never released there.
    Blocks must be short and must not be nested.
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
    # another thread of the parent may have held the old lock
    _gate = _Gate()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(before=_before, after_in_parent=_in_parent, after_in_child=_in_child)
