"""Commands that are asked to end by a signal."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from threading import current_thread, main_thread
from types import FrameType

# a terminal that is closed, `kill`, `timeout`, a machine that is shut down
ENDING = [getattr(signal, name) for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name)]


class Ended(KeyboardInterrupt):
    """A signal asked the process to end; it is handled as Ctrl-C is. `number` is the signal's."""

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
    """What a shell expects of a command that was ended so: 130 after Ctrl-C, 128 and the signal's number otherwise."""
    return 128 + (error.number if isinstance(error, Ended) else signal.SIGINT)


def end_of(error: KeyboardInterrupt) -> str:
    """How it ended, in a word."""
    return f"ended by {error}" if isinstance(error, Ended) else "interrupted"
