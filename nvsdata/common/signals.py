"""Signals that end a command, handled like Ctrl-C."""

from __future__ import annotations

import signal
import time
import weakref
from _thread import LockType, allocate_lock, start_new_thread
from collections.abc import Iterator
from contextlib import contextmanager
from threading import current_thread, main_thread
from types import CodeType, FrameType

# sent when a terminal is closed, by `kill` and `timeout`, and when a machine is shut down
ENDING = [getattr(signal, name) for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name)]

AGAIN_S = 0.01  # s after which a signal that arrived within a protected function is sent again, by a thread
LOST_S = 1.0  # s to wait at the end of the block for that thread, before the signal is sent without it


class Ended(KeyboardInterrupt):
    """A request to end the process, handled like Ctrl-C.

    Args:
        number: number of the signal.
    """

    def __init__(self, number: int) -> None:
        super().__init__(signal.Signals(number).name)
        self.number = number


@contextmanager
def ending_by_signals() -> Iterator[None]:
    """Make SIGTERM and SIGHUP raise `Ended` in the block, where Ctrl-C would raise KeyboardInterrupt.

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


@contextmanager
def never_within(codes: set[CodeType]) -> Iterator[None]:
    """Delay Ctrl-C, SIGTERM and SIGHUP, in the block, while a function with one of these code objects is running.

    For functions that a C library calls: the library would lose or misreport an exception that is raised in them.
    Outside the main thread nothing is done.
    """
    waiting: list[tuple[int, LockType]] = []
    numbers = (signal.SIGINT, *ENDING) if current_thread() is main_thread() else ()
    before = {number: handler for number in numbers if callable(handler := signal.getsignal(number))}

    def handle(number: int, frame: FrameType | None) -> None:
        caller = frame
        while caller is not None:
            # Python ignores exceptions in callbacks of weak references
            if caller.f_code in codes or caller.f_code.co_filename == weakref.__file__:
                raised = allocate_lock()
                raised.acquire()
                waiting.append((number, raised))
                # threading.Thread.start waits for the new thread, and a handler must not wait
                start_new_thread(_raise_later, (number, raised))
                return
            caller = caller.f_back
        before[number](number, frame)

    for number in before:
        signal.signal(number, handle)
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        for number, raised in waiting:
            if not raised.acquire(timeout=LOST_S):
                signal.raise_signal(number)


def _raise_later(number: int, raised: LockType) -> None:
    time.sleep(AGAIN_S)
    signal.raise_signal(number)
    raised.release()


def exit_code(error: KeyboardInterrupt) -> int:
    """Return the exit code of a command that was ended: 128 plus the signal's number, which is 130 for Ctrl-C."""
    return 128 + (error.number if isinstance(error, Ended) else signal.SIGINT)


def end_of(error: KeyboardInterrupt) -> str:
    """Return a message on how the command ended."""
    return f"ended by {error}" if isinstance(error, Ended) else "interrupted"
