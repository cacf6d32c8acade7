"""Samples whose randomness depends on the seed, the epoch and the index, and on nothing else."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import torch
from torch.utils.data import Dataset, Sampler, get_worker_info

from nvsdata.common.memory import SharedArray

Key = tuple[int, int]
"""Epoch and index of a sample: what `SeededBatches` yields and `SeededDataset` takes."""

PASSES = 64  # whose epochs are remembered: loaders that are read at the same time
STEP, FIRST, SECOND = 0x9E3779B97F4A7C15, 0xBF58476D1CE4E5B9, 0x94D049BB133111EB  # odd numbers of well-mixed bits
MAIN = -1  # in place of a base seed, none of which is negative

_seeding = False


@contextmanager
def seeded(seed: int, epoch: int, index: int) -> Iterator[None]:
    """Within the block, torch's generator starts from (seed, epoch, index); afterwards its state is restored.

    A block inside another one changes nothing: the outer seed stays in force.
    """
    global _seeding
    if _seeding:
        yield
        return
    # odd constants, so that different (seed, epoch, index) don't give the same number
    mixed = (seed * STEP + epoch * FIRST + index * SECOND) % 2**63
    with torch.random.fork_rng(devices=[]):
        torch.default_generator.manual_seed(mixed)
        _seeding = True
        try:
            yield
        finally:
            _seeding = False


class Epochs:
    """The epoch of each sample that a dataset gives: set by the user, or counted; shared by all workers of a loader.

    A pass begins an epoch. A pass shows in a worker by the base seed of the loader's iterator, which persistent workers
    keep and the main process doesn't have. There, an epoch begins with the first sample that comes a second time.

    - `count`: number of samples
    """

    def __init__(self, count: int) -> None:
        # of each sample: 1 + the epoch in which it was given last
        self._given = SharedArray(count, np.int64)
        # 1 + the epoch that was set, number of epochs begun; then base seed and epoch of the last passes
        self._state = SharedArray(2 + 2 * PASSES, np.int64)

    def set(self, epoch: int) -> None:
        """Use this epoch for all samples until the next call."""
        self._state.values[0] = epoch + 1

    def of(self, index: int) -> int:
        """Return the epoch of a sample that is about to be given."""
        state = self._state.values
        if state[0]:
            return int(state[0]) - 1
        worker = get_worker_info()
        key = MAIN if worker is None else worker.seed - worker.id
        keys, epochs = state[2::2], state[3::2]
        # read before the keys: workers that begin a pass at the same moment then write the same
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

    The samples then depend neither on the number of workers nor on where a run was resumed.

    - `dataset`: any dataset with a length
    - `seed`: of the run (default 0)

    `ds[epoch, index]` is `dataset[index]` with torch's generator seeded by (seed, epoch, index).
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
    """A `batch_sampler` of keys for several epochs, one after the other.

    The last batch of an epoch may be smaller. Epochs follow without a break, so workers fetch the next epoch while
    the current one ends.

    - `size`: number of samples
    - `batch_size`: samples per batch, of all processes together
    - `first`, `last`: epochs first to last - 1 (default 0 and 1: one epoch)
    - `shuffle`: whether each epoch has its own random order, drawn from `seed` (default False)
    - `seed`: of the orders (default 0)
    - `part`: (rank, count) of this process among `count` that share each batch, in order of rank (default (0, 1)).
      A process for which nothing is left of a last batch skips that batch.
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
        shares = self._share(torch.arange(self.batch_size)), self._share(torch.arange(self.size % self.batch_size))
        return (self.size // self.batch_size) * bool(len(shares[0])) + bool(len(shares[1]))

    def _share(self, batch: torch.Tensor) -> torch.Tensor:
        return batch.tensor_split(self.count)[self.rank]

    def __len__(self) -> int:
        return self.batches * (self.last - self.first)

    def __iter__(self) -> Iterator[list[Key]]:
        for epoch in range(self.first, self.last):
            generator = torch.Generator().manual_seed(self.seed * 1_000_003 + epoch)
            order = torch.randperm(self.size, generator=generator) if self.shuffle else torch.arange(self.size)
            for batch in torch.split(order, self.batch_size):
                if share := self._share(batch).tolist():
                    yield [(epoch, index) for index in share]
