"""Random orders for slow storage: blocks of samples that lie next to each other, several at a time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from nvsdata.common.validation import whole
from nvsdata.datasets.order import shuffled
from nvsdata.datasets.store.reader import Store

AT_ONCE = 64  # blocks whose samples are mixed


@dataclass(frozen=True, eq=False)
class SampleBlocks:
    """Samples in the order in which they lie in a store, cut into blocks. `Samples.blocks` makes them.

    Args:
        order: Indices of the samples in the order of their records, int64 [N].
        ends: End of each block in this order, int64 [K].
        at_once: Smallest number of blocks whose samples are mixed (default 64).
    """

    order: np.ndarray
    ends: np.ndarray
    at_once: int = AT_ONCE

    def shuffled(self, positions: np.ndarray, seed: int, epoch: int) -> tuple[np.ndarray, np.ndarray]:
        """Return the indices at some positions of a random order of all samples.

        The samples of at least `at_once` blocks are mixed (of all, if there are fewer). These blocks are taken at
        random from equal parts of the store, one from each, so that each mixture is like the entire store: a store
        may be sorted by class.

        Args:
            positions: int64 [M], each from 0 to N - 1.
            seed: Seed of the order.
            epoch: Number of the epoch; each has its own order.

        Returns:
            Indices of samples, int64 [M], and their places if the epoch had block after block, int64 [M].
        """
        begins, shifts, groups = self._of_epoch(seed, epoch)
        group = np.searchsorted(groups, positions, "right") - 1
        mixed = np.empty_like(positions)
        for one in np.unique(group):
            first, end = groups[one], groups[one + 1]
            inside = group == one
            # an order of its own for each group: the seed is that of the epoch, and the number that of the group
            mixed[inside] = first + shuffled(positions[inside] - first, int(end - first), seed * _ODD + epoch, int(one))
        block = np.searchsorted(begins, mixed, "right") - 1
        found: np.ndarray = self.order[mixed + shifts[block]]
        return found, mixed

    @lru_cache(maxsize=2)  # noqa: B019  the instance lives as long as its run
    def _of_epoch(self, seed: int, epoch: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return where each block begins in an epoch, what leads from there to `order`, and where groups begin and end.

        The last of the groups' numbers is N.
        """
        sizes = np.diff(self.ends, prepend=0)
        group = self._groups(seed, epoch)
        # within a group, in random order: processes divide its blocks among them in this order
        which = shuffled(np.arange(sizes.size), sizes.size, seed, epoch)
        which = which[np.argsort(group[which], kind="stable")]
        ends = np.cumsum(sizes[which])
        begins = ends - sizes[which]
        first = np.flatnonzero(np.diff(group[which], prepend=-1))
        return begins, (self.ends - sizes)[which] - begins, np.append(begins[first], ends[-1])

    def _groups(self, seed: int, epoch: int) -> np.ndarray:
        """Return the group of each block in an epoch, int64 [K]; a group has one block of each equal part of the store.

        The last part may be smaller, so that only some groups have a block of it.
        """
        count = self.ends.size
        number = max(count // self.at_once, 1)
        parts = [np.arange(first, min(first + number, count)) - first for first in range(0, count, number)]
        # an order of its own for each part: negative numbers, because those of the groups are from 0 on
        orders = [shuffled(part, number, seed * _ODD + epoch, -1 - i) for i, part in enumerate(parts)]
        return np.concatenate(orders)


_ODD = 0x2545F4914F6CDD1D  # a multiplier with well-mixed bits, of xorshift* (Vigna 2016)


def blocks_of(source: object, names: Sequence[str], size: int, at_once: int) -> SampleBlocks:
    """Return the samples of a store in blocks of `size` bytes; `names` are those of their records.

    Raises:
        ValueError: `source` isn't a store of the third layout, or a number is less than 1.
    """
    whole("size", size, 1)
    whole("at_once", at_once, 1)
    if not isinstance(source, Store) or (keys := source.blocks(names, size)) is None:
        raise ValueError("only a packed store has blocks: pack the dataset with `nvsdata pack`")
    order = np.argsort(keys, kind="stable")
    ends = np.append(np.flatnonzero(np.diff(keys[order])) + 1, keys.size)
    return SampleBlocks(order, ends, at_once)
