"""Calls of a function for many items, in this process, in several processes, or on a Dask cluster."""

from __future__ import annotations

import logging
import signal
import time
from collections import deque
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import CancelledError, Future, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing import active_children
from threading import Event
from typing import Any, TypeVar

from nvsdata.common.prefetch import stay_in_one_thread
from nvsdata.common.processes import process_pool
from nvsdata.common.progress import say_above_bar
from nvsdata.common.threads import during_block

Task = TypeVar("Task")
Result = TypeVar("Result")
AHEAD = 8  # items per process whose results may wait, if order matters
RETRIES = 3  # repetitions of an item whose worker was lost
CHECK_S = 5.0  # s between two checks of the cluster's workers
PATIENCE_S = 300.0  # s to wait for a worker


def as_done(
    work: Callable[[Task], Result], items: Sequence[Task], processes: int = 1, scheduler: str | None = None
) -> Generator[Result]:
    """Yield the results of `work` in the order in which they are finished.

    Args:
        work: Function of an item.
        items: Items; for a cluster, each has a `name`.
        processes: Number of processes; 1 calls `work` in this process.
        scheduler: Address of a Dask cluster whose workers call `work` instead. A lost worker is replaced by another.
            If there is no worker, a line on stderr says so, and the items wait for one, at most five minutes.

    Raises:
        ImportError: Dask isn't installed (`nvsdata[distributed]`).
        OSError: A process was killed, the scheduler doesn't answer or is lost, there is no worker for five minutes, or
            several workers were killed while they processed the same item.
    """
    if scheduler is not None:
        yield from _by_cluster(work, items, scheduler)
    elif processes == 1 or len(items) < 2:
        yield from map(work, items)
    else:
        with _workers(min(processes, len(items)), _module_of(work)) as workers:
            for future in as_completed([workers.submit(work, item) for item in items]):
                yield future.result()


def in_order(work: Callable[[Task], Result], items: Sequence[Task], processes: int = 1) -> Generator[Result]:
    """Yield the results of `work` in the order of the items; each process works at most `AHEAD` items ahead.

    Raises:
        OSError: A process was killed.
    """
    if processes == 1:
        yield from map(work, items)
        return
    with _workers(processes, _module_of(work)) as workers:
        waiting: deque[Future[Result]] = deque()
        for item in items:
            waiting.append(workers.submit(work, item))
            if len(waiting) >= AHEAD * processes:
                yield waiting.popleft().result()
        while waiting:
            yield waiting.popleft().result()


def _module_of(work: Callable[..., Any]) -> str:
    """Return the module of a function, or of the function in a `functools.partial`."""
    return str(getattr(work, "func", work).__module__)


@contextmanager
def _workers(count: int, module: str) -> Iterator[Any]:
    """Start processes that have imported a module; if the block raises, they are ended."""
    others = set(active_children())  # children that the calling program started before
    with process_pool(count, module, _prepare) as workers:
        try:
            yield workers
        except BrokenProcessPool:
            raise OSError("a worker process was killed (out of memory?): the same command resumes") from None
        except BaseException:
            # work in progress may take minutes; the next run repeats it
            workers.shutdown(wait=False, cancel_futures=True)
            for process in (own := set(active_children()) - others):
                process.terminate()
            for process in own:
                process.join()
            raise


def _prepare() -> None:
    """Set up a worker: it ignores Ctrl-C, which its parent handles, and uses one thread, to leave cores to others."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    stay_in_one_thread()


def _by_cluster(work: Callable[[Task], Result], items: Sequence[Task], scheduler: str) -> Iterator[Result]:
    """Yield the results of a Dask cluster's workers as they are done."""
    try:
        from distributed import Client, KilledWorker
        from distributed import as_completed as as_completed_there
    except ImportError:
        raise ImportError("a scheduler needs Dask: pip install 'nvsdata[distributed]'") from None
    # the client's log would print the traceback of a lost connection, which the error below reports
    with _only_critical(logging.getLogger("distributed.client")), Client(scheduler) as client:
        # not pure: a run that resumes must repeat an item, even if the cluster still has its earlier result
        futures = client.map(work, items, pure=False, retries=RETRIES)
        named = {future.key: item for future, item in zip(futures, items, strict=True)}
        with _watched(client, scheduler, futures) as reasons:
            try:
                for future in as_completed_there(futures):
                    try:
                        yield future.result()
                    except KilledWorker as error:
                        raise OSError(f"{getattr(named[future.key], 'name', '')}: {error}") from None
                    except CancelledError:
                        raise OSError(reasons[0] if reasons else f"the scheduler at {scheduler} is gone") from None
            finally:
                if client.status == "running":
                    client.cancel(futures)


@contextmanager
def _only_critical(log: logging.Logger) -> Iterator[None]:
    """Silence a log, except for critical messages, while the block runs."""
    level = log.level
    log.setLevel(logging.CRITICAL)
    try:
        yield
    finally:
        log.setLevel(level)


@contextmanager
def _watched(client: Any, scheduler: str, futures: list[Any]) -> Iterator[list[str]]:
    """Watch the cluster's workers while the block runs; if there is none for `PATIENCE_S`, cancel the futures.

    Yields a list. If the futures are cancelled, the reason is added to it.
    """
    reasons: list[str] = []

    def watch(ended: Event) -> None:
        seen, waiting = time.monotonic(), False
        while not ended.wait(CHECK_S):
            try:
                workers = len(client.nthreads())
            except Exception:
                # a lost scheduler cancels the futures
                return
            if workers:
                seen, waiting = time.monotonic(), False
            elif not waiting:
                waiting = True
                say_above_bar(f"no worker at {scheduler}: waiting for one, at most {PATIENCE_S:.0f} s")
            elif time.monotonic() - seen > PATIENCE_S:
                reasons.append(f"no worker at {scheduler} for {PATIENCE_S:.0f} s")
                client.cancel(futures, force=True)
                return

    with during_block(watch, "nvsdata-workers"):
        yield reasons
