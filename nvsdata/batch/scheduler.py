"""Calls of a function for many items, in this process, in several processes, or on a Dask cluster."""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from itertools import islice
from typing import Any, TypeVar

from nvsdata.batch.cluster import Cluster
from nvsdata.batch.local import LocalProcesses

Task = TypeVar("Task")
Result = TypeVar("Result")
AHEAD = 8  # items per worker that are in progress or whose results wait


def as_done(
    work: Callable[[Task], Result], items: Sequence[Task], processes: int = 1, scheduler: str | None = None
) -> Generator[Result]:
    """Yield the results of `work` in the order in which they are finished.

    The items of a worker that is killed are done again by another one.

    Args:
        work: Function of an item, which can be pickled unless it is called in this process. Each worker gets it once.
        items: Items.
        processes: Number of processes; 1 calls `work` in this process.
        scheduler: Address of a Dask cluster whose workers call `work` instead. If there is no worker, a line on stderr
            says so, and the items wait for one, at most five minutes.

    Raises:
        ImportError: Dask isn't installed (`nvsdata[distributed]`).
        OSError: An item's process was killed four times, the scheduler doesn't answer or is lost, or there is no worker
            for five minutes.
    """
    return _results(work, items, processes, scheduler, ordered=False)


def in_order(
    work: Callable[[Task], Result], items: Sequence[Task], processes: int = 1, scheduler: str | None = None
) -> Generator[Result]:
    """Yield the results of `work` in the order of the items; parameters and errors are those of `as_done`.

    Each worker works at most `AHEAD` items ahead, so that results don't fill the memory.
    """
    return _results(work, items, processes, scheduler, ordered=True)


def in_shard(items: Sequence[Task], shard: tuple[int, int] | None) -> Sequence[Task]:
    """Return the items of shard (i, n): every n-th item from the i-th on, counted from 1; all for None.

    Raises:
        ValueError: Unless i and n are integers and 1 <= i <= n.
    """
    match shard:
        case None:
            return items
        case [first, step] if type(first) is type(step) is int and 1 <= first <= step:
            return items[first - 1 :: step]
    raise ValueError(f"shard must be (i, n) with integers 1 <= i <= n, not {shard}")


def _results(
    function: Callable[[Task], Result], items: Sequence[Task], processes: int, scheduler: str | None, *, ordered: bool
) -> Generator[Result]:
    if scheduler is None and (processes == 1 or len(items) < 2):
        yield from map(function, items)
        return
    rest, waiting = iter(items), dict[Any, Task]()
    with (
        LocalProcesses(function, min(processes, len(items)), ordered=ordered)
        if scheduler is None
        else Cluster(function, scheduler, ordered=ordered)
    ) as workers:
        while True:
            for item in islice(rest, max(AHEAD * workers.count - len(waiting), 0)):
                waiting[workers.submit(item)] = item
            if not waiting:
                return
            work = workers.next(waiting)
            yield workers.result(work, waiting.pop(work))
