"""Steps of a pipeline in threads: decoding, emulating and writing overlap, because they release Python's GIL."""

from __future__ import annotations

import atexit
import os
from collections import deque
from collections.abc import Iterator
from threading import Condition, Thread
from time import thread_time
from typing import Any, Generic, TypeVar

Item = TypeVar("Item")
DEPTH = 8  # items that are made in advance
PATIENCE = 0.005  # s that the consumer waits for several items instead of one
LONGEST = 5  # s that the process, when it ends, waits for an item that is being made


_alone = False


def stay_in_one_thread() -> None:
    """Use no threads from now on: for a process whose siblings keep the other cores busy."""
    global _alone
    _alone = True


def in_one_thread() -> bool:
    """Return whether `stay_in_one_thread` was called."""
    return _alone


def prefetch(items: Iterator[Item], worth: float = 0) -> Iterator[Item]:
    """Yield the items, up to `DEPTH` of which are made in advance in a separate thread.

    An error of `items` is raised in place of the item. Closing the generator stops the thread and closes `items`.

    Args:
        items: the items.
        worth: processor time per item, in s, from which a thread is worthwhile: it starts after `DEPTH` items in a row
            that took longer. 0 (default) starts it at once.
    """
    try:
        slow = 0
        while _alone or slow < (DEPTH if worth else 0):
            before = thread_time()
            try:
                item = next(items)
            except StopIteration:
                return
            slow = slow + 1 if thread_time() - before > worth else 0
            yield item
        yield from _by_thread(items)
    finally:
        if hasattr(items, "close"):
            items.close()


def _by_thread(items: Iterator[Item]) -> Iterator[Item]:
    queue = _Queue(items)
    thread = Thread(target=queue.fill, name="nvsdata-ahead", daemon=True)
    thread.start()
    _running[thread] = queue
    try:
        while found := queue.take():
            yield from found
    finally:
        queue.stop()
        thread.join()
        _running.pop(thread, None)


class _Queue(Generic[Item]):
    """Queue of items from one thread to another.

    Waking a thread often takes longer than making an item, so each thread sleeps until it can handle several: the
    producer until the queue is empty, the consumer until it is half full or `PATIENCE` has passed.
    """

    def __init__(self, items: Iterator[Item]) -> None:
        self._items = items
        self._made: deque[Item] = deque()
        self._change = Condition()
        self._error: BaseException | None = None
        self._reason: BaseException | None = None
        self._ended = self._stopped = self._starving = False

    def fill(self) -> None:
        """Make items until there are no more, or `stop` is called."""
        try:
            for item in self._items:
                with self._change:
                    self._made.append(item)
                    if len(self._made) >= DEPTH // 2 or self._starving:
                        self._change.notify()
                    if len(self._made) >= DEPTH:
                        self._change.wait_for(lambda: not self._made or self._stopped)
                    if self._stopped:
                        return
        except BaseException as error:
            self._error = error
        finally:
            with self._change:
                self._ended = True
                self._change.notify()

    def take(self) -> list[Item]:
        """Return the items made so far, at least one; [] at the end. After the last item, raise its source's error."""
        with self._change:
            # an item of a slow source, such as a camera's frame, is taken as soon as it is made
            self._change.wait_for(lambda: len(self._made) >= DEPTH // 2 or self._ended, PATIENCE)
            self._starving = True
            self._change.wait_for(lambda: bool(self._made) or self._ended)
            self._starving = False
            found = list(self._made)
            self._made.clear()
            self._change.notify()
        if not found and (error := self._error or self._reason) is not None:
            raise error
        return found

    def stop(self, error: BaseException | None = None) -> None:
        """Make the producer stop after its current item; `take` then raises `error`, if given, at the end."""
        with self._change:
            self._stopped, self._reason = True, error
            self._change.notify()


_running: dict[Thread, _Queue[Any]] = {}


@atexit.register
def _end() -> None:
    """Stop all threads: a thread that is still in a library's code when Python ends would abort the process.

    A user's thread that takes items gets SystemExit: the end of the process must not look like the end of the items.
    """
    for queue in (waiting := dict(_running)).values():
        queue.stop(SystemExit())
    for thread in waiting:
        thread.join(LONGEST)


if hasattr(os, "register_at_fork"):
    # the threads don't run in a forked process, and their locks may be held there
    os.register_at_fork(after_in_child=_running.clear)
