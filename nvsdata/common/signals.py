"""Ending commands by a signal."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from threading import current_thread, main_thread
from types import FrameType

# sent when a terminal is closed, by `kill` and `timeout`, and when a machine is shut down
ENDING = [getattr(signal, name) for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name)]


class Ended(KeyboardInterrupt):
    """A signal asked the process to end; it is handled like Ctrl-C. `number` is the signal's number."""

    def __init__(self, number: int) -> None:
        super().__init__(signal.Signals(number).name)
        self.number = number


@contextmanager
def ending_by_signals() -> Iterator[None]:
    """While the block runs, SIGTERM and SIGHUP raise `Ended` where Ctrl-C would raise KeyboardInterrupt.

    A signal that is ignored (nohup) stays ignored. Outside the main thread nothing is done.
    """

    def end(number: int, _: FrameType | None) -> None:
        raise Ended(number)

    mine = [s for s in ENDING if current_thread() is main_thread() and signal.getsignal(s) is signal.SIG_DFL]
    for number in mine:
        signal.signal(number, end)
    try:
        yield
    finally:
        for number in mine:
            signal.signal(number, signal.SIG_DFL)


def exit_code(error: KeyboardInterrupt) -> int:
    """The exit code of a command that was ended in this way: 128 plus the signal's number, so 130 after Ctrl-C."""
    return 128 + (error.number if isinstance(error, Ended) else signal.SIGINT)


def end_of(error: KeyboardInterrupt) -> str:
    """How the command ended, in words."""
    return f"ended by {error}" if isinstance(error, Ended) else "interrupted"
