"""Processes of this computer that call a function for many items."""

from __future__ import annotations

import signal
import traceback
from collections import deque
from collections.abc import Callable, Iterable
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from typing import Any, Self

from nvsdata.common.prefetch import stay_in_one_thread
from nvsdata.common.processes import connected_process
from nvsdata.common.progress import say_above_bar

MOST_KILLED = 3  # processes that an item may kill and be begun again
NOT_ENDED = "worker processes were killed (out of memory?): the same command resumes"
# a script without it starts itself again in each process
NEVER_BEGUN = 'worker processes ended at once: does the script do its work below `if __name__ == "__main__":`?'


class RemoteTraceback(Exception):
    """The traceback of an error in another process, as text."""

    def __str__(self) -> str:
        return f"\n{self.args[0]}"


class Work:
    """An item that was submitted. Once it is `done`, `result` is that of the function, or `error` what it raised."""

    def __init__(self, item: Any) -> None:
        self.item, self.done, self.killed = item, False, 0
        self.result: Any = None
        self.error: BaseException | None = None


class LocalProcesses:
    """Several processes, to be used in a `with` block; if the block raises, they are ended.

    Each has its own connection, because one that is killed while it writes to a shared one would block all others.

    Args:
        work: Function of an item, sent to each process once.
        count: Number of processes.
        ordered: Whether results are taken in the order of the items.
    """

    def __init__(self, work: Callable[[Any], Any], count: int, *, ordered: bool) -> None:
        if count < 1:
            raise ValueError(f"the number of processes must be at least 1, not {count}")
        self.count, self._work, self._ordered = count, work, ordered
        self._idle: list[Connection] = []
        self._busy: dict[Connection, Work] = {}
        self._processes: dict[Connection, BaseProcess] = {}
        self._queue: deque[Work] = deque()
        self._began = False

    def __enter__(self) -> Self:
        return self

    def submit(self, item: Any) -> Work:
        """Begin an item, or keep it until a process is idle."""
        work = Work(item)
        self._queue.append(work)
        self._feed()
        return work

    def next(self, waiting: Iterable[Work]) -> Work:
        """Return the item whose result is taken next."""
        while True:
            for work in waiting:
                if work.done:
                    return work
                if self._ordered:
                    break
            for connection in wait(list(self._busy)):
                self._receive(connection)  # type: ignore[arg-type]

    def result(self, work: Work, item: Any) -> Any:
        """Return the result of an item, or raise what the function raised."""
        if work.error is not None:
            raise work.error
        return work.result

    def _feed(self) -> None:
        """Send items to idle processes, and start processes while there are fewer than `count`."""
        while self._queue and (self._idle or len(self._processes) < self.count):
            if not self._idle:
                self._start()
            connection = self._idle.pop()
            work = self._busy[connection] = self._queue.popleft()
            try:
                connection.send(work.item)
            except (BrokenPipeError, ConnectionResetError):
                self._lost(connection)

    def _start(self) -> None:
        module = str(getattr(self._work, "func", self._work).__module__)
        process, connection = connected_process(_serve, self._work, module)
        self._processes[connection] = process
        self._idle.append(connection)

    def _receive(self, connection: Connection) -> None:
        """Take a result, and send the next item."""
        try:
            result, error, trace = connection.recv()
        except (EOFError, ConnectionResetError):
            self._lost(connection)
        else:
            self._began = True
            work = self._busy.pop(connection)
            work.result, work.error, work.done = result, error, True
            if error is not None:
                error.__cause__ = RemoteTraceback(trace)
            self._idle.append(connection)
        self._feed()

    def _lost(self, connection: Connection) -> None:
        """Begin the item of a process that was killed again. OSError if that doesn't help."""
        connection.close()
        self._processes.pop(connection).join()
        work = self._busy.pop(connection)
        work.killed += 1
        if work.killed > MOST_KILLED:
            raise OSError(NOT_ENDED if self._began else NEVER_BEGUN)
        say_above_bar("a worker process was killed (out of memory?): its item is done again")
        self._queue.appendleft(work)

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        for connection, process in self._processes.items():
            if kind is not None:
                # work in progress may take minutes; the next run repeats it
                process.terminate()
            connection.close()
        for process in self._processes.values():
            process.join()


def _serve(connection: Connection, work: Callable[[Any], Any]) -> None:
    """Call the function for each item that comes, until the connection is closed.

    The process ignores Ctrl-C, which its parent handles, and uses one thread, to leave cores to others.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    stay_in_one_thread()
    while True:
        try:
            item = connection.recv()
        except EOFError:
            return
        answer: tuple[Any, Exception | None, str]
        try:
            answer = work(item), None, ""
        except Exception as error:
            answer = None, error, traceback.format_exc()
        try:
            connection.send(answer)
        except OSError:
            # the parent has ended
            return
        except Exception as error:
            # the result can't be pickled, or the error
            reason = RuntimeError(f"{answer[1] or 'a result'} can't be sent to another process: {error}")
            connection.send((None, reason, answer[2] or traceback.format_exc()))
