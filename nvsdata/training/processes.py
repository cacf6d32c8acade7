"""Processes that train together."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import torch
from torch import distributed

from nvsdata.common.errors import message_of
from nvsdata.common.files import claimed

Result = TypeVar("Result")


class ProcessFailed(RuntimeError):
    """Another process of the team failed; the message has its rank and its error."""


@dataclass(frozen=True)
class Team:
    """The processes that train together, and the rank of this process. Rank 0 writes and prints.

    Args:
        device: Device of this process.
        rank: Number of this process (default 0).
        count: Number of processes (default 1).

    Example:
        >>> import torch
        >>> from nvsdata import training
        >>> training.Team(torch.device("cpu")).rank
        0
    """

    device: torch.device
    rank: int = 0
    count: int = 1

    @property
    def workers(self) -> int:
        """Number of processes that prepare samples. These processes and torch's threads share the CPU cores."""
        return max(1, min(4, (os.cpu_count() or 2) // (2 * self.count)))

    def barrier(self) -> None:
        """Wait until all processes have called this."""
        if self.count > 1:
            distributed.barrier()

    def gather(self, value: Result) -> list[Result]:
        """Return the values of all processes, in order of rank. All processes must call this."""
        if self.count == 1:
            return [value]
        everyone: list[Any] = [None] * self.count
        distributed.all_gather_object(everyone, value)
        return everyone

    def attempt(self, work: Callable[[], Result]) -> list[Result]:
        """Call a function in each process, and return the results of all, in order of rank.

        All processes must call this. If the function fails in one of them, all of them raise an error, so that none
        waits for a process that has ended.

        Args:
            work: Function of this process. Its result must be picklable.

        Returns:
            The results, the same in all processes.

        Raises:
            Exception: The error of `work` in this process.
            ProcessFailed: `work` failed in another process.

        Example:
            >>> import torch
            >>> from nvsdata import training
            >>> training.Team(torch.device("cpu")).attempt(lambda: 1 + 1)
            [2]
        """
        if self.count == 1:
            return [work()]
        try:
            result, failure = work(), None
        except Exception as error:
            self.gather((None, message_of(error)))
            raise
        everyone = self.gather((result, failure))
        for rank, (_, message) in enumerate(everyone):
            if message is not None:
                raise ProcessFailed(f"process {rank}: {message}")
        return [found for found, _ in everyone]

    @contextmanager
    def claiming(self, out: Path) -> Iterator[None]:
        """Create the folder `out` and lock it while the block runs. Remnants of killed runs are removed.

        Raises OutputInUse if another run writes to it.
        """
        if self.rank:
            yield
            return
        out.mkdir(parents=True, exist_ok=True)
        with claimed(out):
            yield

    def print(self, text: str) -> None:
        """Print a text, in the first process only."""
        if self.rank == 0:
            print(text, flush=True)


@contextmanager
def team(device: str | None = None) -> Iterator[Team]:
    """Join the processes that torchrun started, or train alone.

    Args:
        device: Device (default None: a GPU if there is one, otherwise the CPU).

    Yields:
        The `Team`.

    Example:
        >>> from nvsdata import training
        >>> with training.team("cpu") as team:
        ...     team.count
        1
    """
    name = device or ("cuda" if torch.cuda.is_available() else "cpu")
    count = int(os.environ.get("WORLD_SIZE", "1"))
    if count == 1:
        alone = Team(torch.device(name))
        torch.set_num_threads(max(1, (os.cpu_count() or 2) - alone.workers))
        yield alone
        return
    if name == "cuda":
        name = f"cuda:{os.environ.get('LOCAL_RANK', '0')}"
        torch.cuda.set_device(name)
    distributed.init_process_group("nccl" if name.startswith("cuda") else "gloo")
    try:
        yield Team(torch.device(name), distributed.get_rank(), count)
    finally:
        distributed.destroy_process_group()
