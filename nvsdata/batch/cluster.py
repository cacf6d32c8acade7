"""A Dask cluster whose workers call a function for many items."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import CancelledError
from contextlib import ExitStack, contextmanager
from functools import lru_cache
from threading import Event
from typing import Any, Self

from nvsdata.common.progress import say_above_bar
from nvsdata.common.threads import during_block

CHECK_S = 5.0  # s between two checks of the cluster's workers
PATIENCE_S = 300.0  # s to wait for a worker


class Cluster:
    """The workers of a Dask cluster, to be used in a `with` block. A lost worker's items are done by another.

    Args:
        work: Function of an item.
        scheduler: Address of the scheduler.
        ordered: Whether results are taken in the order of the items.
    """

    def __init__(self, work: Callable[[Any], Any], scheduler: str, *, ordered: bool) -> None:
        self._dask = _distributed()
        self._work: bytes = self._dask.protocol.pickle.dumps(work)
        self._scheduler, self._ordered = scheduler, ordered
        self._begun: set[Any] = set()
        self._reason = f"the scheduler at {scheduler} is gone"

    def __enter__(self) -> Self:
        with ExitStack() as opened:
            # the client's log would print the traceback of a lost connection, which the error reports
            opened.enter_context(_only_critical(logging.getLogger("distributed.client")))
            self._client = opened.enter_context(self._dask.Client(self._scheduler))
            self._finished = self._dask.as_completed()
            self.count = self._threads() or 1
            opened.callback(self._cancel)
            opened.enter_context(during_block(self._watch, "nvsdata-workers"))
            self._opened = opened.pop_all()
        return self

    def __exit__(self, *error: Any) -> None:
        self._opened.__exit__(*error)

    def submit(self, item: Any) -> Any:
        """Begin an item."""
        # not pure: a run that resumes must repeat an item, even if the cluster still has its earlier result
        future = self._client.submit(_call, self._work, item, pure=False)
        self._begun.add(future)
        if not self._ordered:
            self._finished.add(future)
        return future

    def next(self, waiting: Iterable[Any]) -> Any:
        """Return the future whose result is taken next."""
        return next(iter(waiting) if self._ordered else self._finished)

    def result(self, future: Any, item: Any) -> Any:
        """Return the result of an item. OSError if the scheduler or all workers are lost."""
        try:
            return future.result()
        except self._dask.KilledWorker as error:
            raise OSError(f"{getattr(item, 'name', item)}: {error}") from None
        except CancelledError:
            raise OSError(self._reason) from None
        finally:
            self._begun.discard(future)

    def _threads(self) -> int:
        return sum(self._client.nthreads().values())

    def _cancel(self) -> None:
        if self._client.status == "running":
            self._client.cancel(list(self._begun))

    def _watch(self, ended: Event) -> None:
        """Watch the workers until the block has ended; if there is none for `PATIENCE_S`, cancel all items."""
        seen, waiting = time.monotonic(), False
        while not ended.wait(CHECK_S):
            try:
                threads = self._threads()
            except Exception:
                # a lost scheduler cancels the futures
                return
            if threads:
                self.count, seen, waiting = threads, time.monotonic(), False
            elif not waiting:
                waiting = True
                say_above_bar(f"no worker at {self._scheduler}: waiting for one, at most {PATIENCE_S:.0f} s")
            elif time.monotonic() - seen > PATIENCE_S:
                self._reason = f"no worker at {self._scheduler} for {PATIENCE_S:.0f} s"
                self._client.cancel(list(self._begun), force=True)
                return


def _call(work: bytes, item: Any) -> Any:
    return _loaded(work)(item)


@lru_cache(maxsize=4)
def _loaded(work: bytes) -> Callable[[Any], Any]:
    """Return a pickled function. A worker loads it once, because it may open a store."""
    found: Callable[[Any], Any] = _distributed().protocol.pickle.loads(work)
    return found


def _distributed() -> Any:
    try:
        import distributed.protocol.pickle
    except ImportError:
        raise ImportError("a scheduler needs Dask: pip install 'nvsdata[distributed]'") from None
    return distributed


@contextmanager
def _only_critical(log: logging.Logger) -> Iterator[None]:
    """Silence a log, except for critical messages, while the block runs."""
    level = log.level
    log.setLevel(logging.CRITICAL)
    try:
        yield
    finally:
        log.setLevel(level)
