"""Videos converted by the workers of a Dask cluster."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterator
from concurrent.futures import CancelledError
from contextlib import contextmanager
from threading import Event, Thread
from typing import Any, TypeVar

from nvsdata.common.progress import say_beside
from nvsdata.emulation.job import Job

Result = TypeVar("Result")
RETRIES = 3  # of a video whose worker was lost
LOOK_S = 5.0  # between two looks at the cluster's workers
PATIENCE_S = 300.0  # without any worker


def results(work: Callable[[Job], Result], jobs: list[Job], scheduler: str) -> Iterator[Result]:
    """What `work` makes of each job, as workers finish them; a worker that is lost is replaced by another.

    If there is no worker, a line on stderr says so, and the jobs wait for one, at most five minutes.

    ImportError without `nvsdata[distributed]`, OSError if the scheduler doesn't answer or goes away, if there is no
    worker for five minutes, or if a video killed one worker after the other.
    """
    try:
        from distributed import Client, KilledWorker, as_completed
    except ImportError:
        raise ImportError("a scheduler needs Dask: pip install 'nvsdata[distributed]'") from None
    # its log would print the traceback of a connection that is lost, which the error below reports
    with _only_critical(logging.getLogger("distributed.client")), Client(scheduler) as client:
        # not pure: a run that goes on must convert a video again, even if the cluster still holds its earlier result
        futures = client.map(work, jobs, pure=False, retries=RETRIES)
        named = {future.key: job for future, job in zip(futures, jobs, strict=True)}
        with _watched(client, scheduler, futures) as reasons:
            try:
                for future in as_completed(futures):
                    try:
                        yield future.result()
                    except KilledWorker as error:
                        raise OSError(f"{named[future.key].video.name}: {error}") from None
                    except CancelledError:
                        raise OSError(reasons[0] if reasons else f"the scheduler at {scheduler} is gone") from None
            finally:
                if client.status == "running":
                    client.cancel(futures)


@contextmanager
def _only_critical(log: logging.Logger) -> Iterator[None]:
    level = log.level
    log.setLevel(logging.CRITICAL)
    try:
        yield
    finally:
        log.setLevel(level)


@contextmanager
def _watched(client: Any, scheduler: str, futures: list[Any]) -> Iterator[list[str]]:
    """While the block runs, look for workers; if there is none for too long, cancel the futures, and say why."""
    reasons: list[str] = []
    ended = Event()

    def watch() -> None:
        seen, waiting = time.monotonic(), False
        while not ended.wait(LOOK_S):
            try:
                workers = len(client.nthreads())
            except Exception:
                # a scheduler that is gone cancels the futures
                return
            if workers:
                seen, waiting = time.monotonic(), False
            elif not waiting:
                waiting = True
                say_beside(f"no worker at {scheduler}: waiting for one, at most {PATIENCE_S:.0f} s")
            elif time.monotonic() - seen > PATIENCE_S:
                reasons.append(f"no worker at {scheduler} for {PATIENCE_S:.0f} s")
                client.cancel(futures, force=True)
                return

    thread = Thread(target=watch, name="nvsdata-workers", daemon=True)
    thread.start()
    try:
        yield reasons
    finally:
        ended.set()
        thread.join()
