"""Samples whose random numbers depend on seed, epoch and index only."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from operator import index
from typing import Any, Literal, get_args

import numpy as np
import torch
from torch.utils.data import Dataset, Sampler

from nvsdata.common.validation import whole
from nvsdata.datasets.order import FIRST, SECOND, STEP, shuffled

Key = tuple[int, int]
"""Epoch and index of a sample: the index that `SeededBatches` yields and `SeededDataset` takes."""

Remainder = Literal["pad", "drop", "keep"]
MOST = 2**62  # samples
AT_ONCE = 4_096  # samples whose order is computed at a time


_seeding = False


@contextmanager
def seeded(seed: int, epoch: int, index: int) -> Iterator[None]:
    """Seed torch's generator by (seed, epoch, index) for the block; its state is restored afterwards.

    A block inside another one changes nothing: the outer seed applies.
    """
    global _seeding
    if _seeding:
        yield
        return
    # odd constants, so that different (seed, epoch, index) don't result in the same number
    mixed = (seed * STEP + epoch * FIRST + index * SECOND) % 2**63
    with torch.random.fork_rng(devices=[]):
        torch.default_generator.manual_seed(mixed)
        _seeding = True
        try:
            yield
        finally:
            _seeding = False


class SeededDataset(Dataset[Any]):
    """A dataset that seeds torch's generator before each sample.

    The samples then depend neither on the number of workers nor on where a run was resumed. Item (epoch, index) is
    `dataset[index]` with torch's generator seeded by (seed, epoch, index).

    Args:
        dataset: any dataset with a length.
        seed: seed of the run.

    Example:
        >>> from torch.utils.data import DataLoader
        >>> from nvsdata.datasets import SeededBatches, SeededDataset
        >>> data = SeededDataset([10, 20, 30, 40, 50])
        >>> data[0, 1]
        20
        >>> [batch.tolist() for batch in DataLoader(data, batch_sampler=SeededBatches(5, 2))]
        [[10, 20], [30, 40], [50]]
    """

    def __init__(self, dataset: Any, seed: int = 0) -> None:
        self.dataset, self.seed = dataset, seed

    def __len__(self) -> int:
        return len(self.dataset)

    def __getitem__(self, key: Key) -> Any:
        epoch, index = key
        with seeded(self.seed, epoch, index):
            return self.dataset[index]


class SeededBatches(Sampler[list[Key]]):
    """A `batch_sampler` of the keys (epoch, index) of several epochs, one epoch after the other.

    A batch depends on the arguments, its epoch and its step only, and is computed when it is needed. So a run can
    continue at any step, with any number of workers and processes. Workers fetch the next epoch while the current one
    ends.

    Args:
        size: Number of samples.
        batch_size: Samples per batch, of all processes together.
        first: First epoch (default 0).
        last: The epoch after the last one (default 1).
        start: Number of steps of the first epoch to leave out, because they are done (default 0).
        shuffle: True for a random order in each epoch (default False).
        seed: Seed of the random orders (default 0).
        part: (rank, count) of this process among `count` processes that divide each batch, in order of rank (default
            (0, 1)).
        remainder: Treatment of the samples that are left for the last batch of an epoch. "pad" (default): the batch is
            smaller, and samples of the epoch's beginning are added until it is a multiple of `count`, so that all
            processes have the same number of steps and samples. "drop": leave them out. "keep": the batch has these
            samples only; if there are fewer than processes, the last of these skip the step.

    Raises:
        ValueError: A number is out of range.
        TypeError: A number isn't an integer.

    Example:
        >>> from nvsdata import SeededBatches
        >>> list(SeededBatches(3, 2))
        [[(0, 0), (0, 1)], [(0, 2)]]
        >>> [list(SeededBatches(3, 2, part=(rank, 2))) for rank in (0, 1)]
        [[[(0, 0)], [(0, 2)]], [[(0, 1)], [(0, 0)]]]
    """

    def __init__(
        self,
        size: int,
        batch_size: int,
        *,
        first: int = 0,
        last: int = 1,
        start: int = 0,
        shuffle: bool = False,
        seed: int = 0,
        part: tuple[int, int] = (0, 1),
        remainder: Remainder = "pad",
    ) -> None:
        self.size, self.batch_size, self.first, self.last = map(index, (size, batch_size, first, last))
        self.start, self.seed, self.rank, self.count = map(index, (start, seed, *part))
        self.shuffle, self.remainder = shuffle, remainder
        for name, least in (("size", 0), ("batch_size", 1), ("first", 0), ("start", 0), ("rank", 0)):
            whole(name, getattr(self, name), least)
        if self.size >= MOST:
            raise ValueError(f"size must be less than {MOST}, not {size}")
        if remainder not in get_args(Remainder):
            raise ValueError(f"remainder must be one of {get_args(Remainder)}, not {remainder!r}")
        if self.rank >= self.count:
            raise ValueError(f"part must be (rank, count) with rank < count, not {part}")
        if self.batch_size % self.count and remainder != "keep":
            raise ValueError(f"{self.count} processes can't have equal parts of a batch of {self.batch_size}")
        steps = self.size // self.batch_size if remainder == "drop" else -(-self.size // self.batch_size)
        self._next = self.first, self.start
        self._resumed: tuple[int, int] | None = None
        self._latest: object = None
        if self.start > steps:
            raise ValueError(f"start must be at most {steps}, the steps of an epoch, not {start}")

    @property
    def steps(self) -> int:
        """Steps per epoch of this process."""
        full, left = divmod(self.size, self.batch_size)
        if self.remainder == "keep":
            # the first processes get one sample more
            return full * (self.batch_size > self.rank) + (left > self.rank)
        return full + (left > 0 and self.remainder == "pad")

    def __len__(self) -> int:
        epoch, step = self._begin
        return max(self.steps * (self.last - epoch) - min(step, self.steps), 0)

    @property
    def _begin(self) -> tuple[int, int]:
        """Epoch and step at which the next iteration begins."""
        return self._resumed or (self.first, self.start)

    def set_epoch(self, epoch: int) -> None:
        """Iterate over this epoch only from now on, from its first step.

        Lightning calls it before each epoch, and needs it because its epochs are passes over the loader.
        """
        whole("epoch", epoch, 0)
        self.first, self.last, self.start, self._resumed = epoch, epoch + 1, 0, None

    @property
    def sampler(self) -> SeededBatches:
        """Itself: Lightning calls `set_epoch` of a batch sampler's sampler."""
        return self

    def state_dict(self) -> dict[str, int]:
        """Return epoch and step of the next batch of the latest iteration.

        torchdata's `StatefulDataLoader` calls it.
        """
        epoch, step = self._next
        return {"epoch": epoch, "step": step}

    def load_state_dict(self, state: dict[str, int]) -> None:
        """Begin the next iteration at the batch of a state. It reaches to the end of that epoch, or to `last`.

        Raises:
            ValueError: An epoch has fewer steps.
        """
        epoch, step = state["epoch"], state["step"]
        if not 0 <= step <= self.steps:
            raise ValueError(f"the state is of step {step}, and an epoch has {self.steps}: of another batch size?")
        self._resumed = self._next = epoch, step
        self.last = max(self.last, epoch + 1)

    def __iter__(self) -> Iterator[list[Key]]:
        # not a generator: `set_epoch` must not move an iteration that has begun
        self._next, self._resumed, self._latest = self._begin, None, object()
        return self._iterated(*self._next, self.last, self._latest)

    def _iterated(self, first: int, start: int, last: int, iteration: object) -> Iterator[list[Key]]:
        # the order of several steps is computed at a time, because each call takes 0.3 ms
        several = max(AT_ONCE // self.batch_size, 1)
        for epoch in range(first, last):
            for begin in range(start if epoch == first else 0, self.steps, several):
                steps = range(begin, min(begin + several, self.steps))
                for step, batch in zip(steps, self._batches(epoch, steps), strict=True):
                    if iteration is self._latest:
                        self._next = epoch, step + 1
                    yield batch

    def batch(self, epoch: int, step: int) -> list[Key]:
        """Return this process's keys of a step. IndexError if an epoch has no such step."""
        if not 0 <= step < self.steps:
            raise IndexError(f"step {step} of an epoch of {self.steps} steps")
        return self._batches(index(epoch), range(step, step + 1))[0]

    def _batches(self, epoch: int, steps: range) -> list[list[Key]]:
        """Return this process's keys of several steps."""
        positions = [self._positions(step) for step in steps]
        order = np.concatenate(positions)
        if self.shuffle:
            order = shuffled(order, self.size, self.seed, epoch)
        ends = np.cumsum([own.size for own in positions])[:-1]
        return [[(epoch, at) for at in own.tolist()] for own in np.split(order, ends)]

    def _positions(self, step: int) -> np.ndarray:
        """Return the positions of this process's samples in an epoch."""
        begin = step * self.batch_size
        positions = np.arange(begin, min(begin + self.batch_size, self.size))
        if self.remainder == "pad":
            positions = np.append(positions, np.arange(-positions.size % self.count) % self.size)
        return np.array_split(positions, self.count)[self.rank]
