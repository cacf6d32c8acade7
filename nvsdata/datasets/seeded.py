"""Samples whose random numbers depend on seed, epoch and index only."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import torch
from torch.utils.data import Dataset, Sampler, get_worker_info

from nvsdata.common.memory import SharedArray

Key = tuple[int, int]
"""Epoch and index of a sample: the index that `SeededBatches` yields and `SeededDataset` takes."""

PASSES = 64  # number of passes whose epochs are stored, for loaders that are read at the same time
STEP, FIRST, SECOND = 0x9E3779B97F4A7C15, 0xBF58476D1CE4E5B9, 0x94D049BB133111EB  # odd numbers with well-mixed bits
MAIN = -1  # key of the main process; base seeds are not negative

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


class Epochs:
    """Epochs of the samples that a dataset returns, set by the user or counted; shared by all workers of a loader.

    Each pass over the data is an epoch. A worker recognizes a new pass by the base seed of the loader's iterator.
    Persistent workers keep that seed, and the main process has none. In both, an epoch begins with the first sample
    that is read a second time.

    Args:
        count: number of samples.
    """

    def __init__(self, count: int) -> None:
        # of each sample: 1 + the epoch in which it was last read
        self._given = SharedArray(count, np.int64)
        # 1 + the epoch that was set, 0 if none was; number of epochs begun; then base seed and epoch of the last passes
        self._state = SharedArray(2 + 2 * PASSES, np.int64)

    def set(self, epoch: int) -> None:
        """Use this epoch for all samples until the next call."""
        self._state.values[0] = epoch + 1

    def of(self, index: int) -> int:
        """Return the epoch of a sample that is about to be read."""
        state = self._state.values
        if state[0]:
            return int(state[0]) - 1
        worker = get_worker_info()
        key = MAIN if worker is None else worker.seed - worker.id
        keys, epochs = state[2::2], state[3::2]
        # read before the keys: workers that begin a pass at the same moment then write the same values
        begun = int(state[1])
        found = epochs[keys == key]
        epoch = int(found.max(initial=-1))
        if epoch < 0 or self._given.values[index] == epoch + 1:
            epoch = begun
            keys[epoch % PASSES], epochs[epoch % PASSES] = key, epoch
            state[1] = epoch + 1
        self._given.values[index] = epoch + 1
        return epoch


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

    The last batch of an epoch may be smaller. Workers fetch the next epoch while the current one ends.

    Args:
        size: number of samples.
        batch_size: samples per batch, of all processes together.
        first: first epoch.
        last: the epoch after the last one.
        shuffle: whether each epoch has its own random order.
        seed: seed of the random orders.
        part: (rank, count) of this process among `count` processes that divide each batch, in order of rank. A process
            without samples in a last batch skips that batch.

    Example:
        >>> from nvsdata.datasets import SeededBatches
        >>> list(SeededBatches(3, 2))
        [[(0, 0), (0, 1)], [(0, 2)]]
    """

    def __init__(
        self,
        size: int,
        batch_size: int,
        *,
        first: int = 0,
        last: int = 1,
        shuffle: bool = False,
        seed: int = 0,
        part: tuple[int, int] = (0, 1),
    ) -> None:
        self.size, self.batch_size = size, batch_size
        self.first, self.last = first, last
        self.shuffle, self.seed = shuffle, seed
        self.rank, self.count = part

    @property
    def batches(self) -> int:
        """Batches per epoch."""
        parts = self._own_part(torch.arange(self.batch_size)), self._own_part(torch.arange(self.size % self.batch_size))
        return (self.size // self.batch_size) * bool(len(parts[0])) + bool(len(parts[1]))

    def _own_part(self, batch: torch.Tensor) -> torch.Tensor:
        return batch.tensor_split(self.count)[self.rank]

    def __len__(self) -> int:
        return self.batches * (self.last - self.first)

    def __iter__(self) -> Iterator[list[Key]]:
        for epoch in range(self.first, self.last):
            generator = torch.Generator().manual_seed(self.seed * 1_000_003 + epoch)
            order = torch.randperm(self.size, generator=generator) if self.shuffle else torch.arange(self.size)
            for batch in torch.split(order, self.batch_size):
                if own := self._own_part(batch).tolist():
                    yield [(epoch, index) for index in own]
