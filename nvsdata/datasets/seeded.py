"""Samples whose random numbers depend on seed, epoch and index only."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from operator import index
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, get_args

import numpy as np
import torch
from torch.utils.data import Dataset

from nvsdata.common.validation import whole
from nvsdata.datasets.order import FIRST, SECOND, STEP, shuffled
from nvsdata.datasets.resumable import ResumableBatches

if TYPE_CHECKING:
    from nvsdata.datasets.sample_blocks import SampleBlocks

Key = tuple[int, int]
"""Epoch and index of a sample: the index that `SeededBatches` yields and `SeededDataset` takes."""


class SequenceKey(NamedTuple):
    """The index that `SequenceBatches` yields and `SeededDataset` takes.

    Attributes:
        epoch: Epoch.
        window: Index of the window.
        start: Index of the first window of its sequence.
        valid: False for padding: a window that is repeated because its sequence has ended.
    """

    epoch: int
    window: int
    start: int
    valid: bool


Remainder = Literal["pad", "drop", "keep"]
MOST = 2**62  # samples


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

    With the keys of `SequenceBatches`, an item is `(sample, target, first, valid)`: `first` is True for the first
    window of a sequence, and `valid` False for padding. The generator is seeded by (seed, epoch, start of the
    sequence), so a random flip or shift is the same in all windows of a sequence. Transforms that sample a number per
    event should be the last ones, because the numbers after them depend on the number of events.

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

    def __getitem__(self, key: Key | SequenceKey) -> Any:
        if isinstance(key, SequenceKey):
            with seeded(self.seed, key.epoch, key.start):
                sample, target = self.dataset[key.window]
            return sample, target, key.valid and key.window == key.start, key.valid
        epoch, index = key
        with seeded(self.seed, epoch, index):
            return self.dataset[index]


class SeededBatches(ResumableBatches[Key]):
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
        blocks: Blocks of neighbors in a packed store, which `dataset.blocks()` returns, for slow disks and servers: the
            random order has the samples of at least 64 blocks at a time, and a process gets neighbors of each batch, so
            that hardly any block is read twice (default None: no blocks). If the store is sorted by class, a process
            has few classes in a batch: batch normalization then needs the statistics of all processes.
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
        blocks: SampleBlocks | None = None,
        part: tuple[int, int] = (0, 1),
        remainder: Remainder = "pad",
    ) -> None:
        super().__init__(batch_size, first, last, start, seed, part)
        self.size, self.shuffle, self.blocks, self.remainder = index(size), shuffle, blocks, remainder
        whole("size", self.size, 0)
        if self.size >= MOST:
            raise ValueError(f"size must be less than {MOST}, not {size}")
        if remainder not in get_args(Remainder):
            raise ValueError(f"remainder must be one of {get_args(Remainder)}, not {remainder!r}")
        if blocks is not None and (not shuffle or blocks.order.size != self.size):
            raise ValueError(f"blocks of {blocks.order.size} samples are for shuffle=True and as many samples")
        if remainder != "keep":
            self._check_parts()
        self._check_start(self.size // self.batch_size if remainder == "drop" else -(-self.size // self.batch_size))

    @property
    def steps(self) -> int:
        """Steps per epoch of this process."""
        full, left = divmod(self.size, self.batch_size)
        if self.remainder == "keep":
            # the first processes get one sample more
            return full * (self.batch_size > self.rank) + (left > self.rank)
        return full + (left > 0 and self.remainder == "pad")

    def _batches(self, epoch: int, steps: range) -> list[list[Key]]:
        """Return this process's keys of several steps."""
        batches = [self._positions(step) for step in steps]
        if self.blocks is None:
            batches = list(map(self._own, batches))
        order, ends = np.concatenate(batches), np.cumsum([batch.size for batch in batches])[:-1]
        places = None
        if self.blocks is not None:
            order, places = self.blocks.shuffled(order, self.seed, epoch)
        elif self.shuffle:
            order = shuffled(order, self.size, self.seed, epoch)
        chosen = np.split(order, ends)
        if places is not None:
            # by the epoch's order of blocks: by that of the store, a process would have the same classes in each epoch
            near = (np.argsort(batch, kind="stable") for batch in np.split(places, ends))
            chosen = [self._own(batch[by]) for batch, by in zip(chosen, near, strict=True)]
        return [[(epoch, at) for at in own.tolist()] for own in chosen]

    def _positions(self, step: int) -> np.ndarray:
        """Return the positions of a step's samples in an epoch."""
        begin = step * self.batch_size
        positions = np.arange(begin, min(begin + self.batch_size, self.size))
        if self.remainder == "pad":
            positions = np.append(positions, np.arange(-positions.size % self.count) % self.size)
        return positions

    def _own(self, batch: np.ndarray) -> np.ndarray:
        """Return this process's part of a batch."""
        return np.array_split(batch, self.count)[self.rank]
