"""Videos converted by the workers of a Dask cluster."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import TypeVar

from nvsdata.emulation.job import Job

Result = TypeVar("Result")
RETRIES = 3  # of a video whose worker was lost


def results(work: Callable[[Job], Result], jobs: list[Job], scheduler: str) -> Iterator[Result]:
    """What `work` makes of each job, as workers finish them; a worker that is lost is replaced by another.

    ImportError without `nvsdata[distributed]`, OSError if the scheduler doesn't answer or a video killed
    one worker after the other.
    """
    try:
        from distributed import Client, KilledWorker, as_completed
    except ImportError:
        raise ImportError("a scheduler needs Dask: pip install 'nvsdata[distributed]'") from None
    with Client(scheduler) as client:
        # not pure: a run that goes on must convert a video again, even if the cluster still holds its earlier result
        futures = client.map(work, jobs, pure=False, retries=RETRIES)
        named = {future.key: job for future, job in zip(futures, jobs, strict=True)}
        try:
            for future in as_completed(futures):
                try:
                    yield future.result()
                except KilledWorker as error:
                    raise OSError(f"{named[future.key].video.name}: {error}") from None
        finally:
            client.cancel(futures)
