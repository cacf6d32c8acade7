"""Files of records whose index takes a pass over the entire file, and is kept next to it."""

from __future__ import annotations

from abc import abstractmethod
from typing import NamedTuple

import numpy as np

from nvsdata.data.events import Columns
from nvsdata.formats import index_cache
from nvsdata.formats.records import Blocks, PiecedFile
from nvsdata.kernels.decode.order import is_sorted


class Entry(NamedTuple):
    """What a few records say about a block of a kept index.

    - `time`, `state`: its entry in `Blocks.times` and `Blocks.states`
    - `first`, `last`: times of the first and the last event of these records, None if they have none
    """

    time: int
    state: list[int]
    first: int | None
    last: int | None


class IndexedFile(PiecedFile):
    """A file whose index is kept, if the file is large, and compared with it where it is used.

    Some entries are compared when the index is restored, and those at the ends of each window when it is decoded. An
    index that differs is made again.
    """

    _unproven: set[int] | None = None  # blocks of a kept index whose entries weren't compared with the file yet

    @property
    def blocks(self) -> Blocks:
        """The index: built at its first use, or kept from an earlier one."""
        if self._blocks is None:
            self._blocks = self._kept() or self._made()
        return self._blocks

    def _kept(self) -> Blocks | None:
        """The index kept next to the file; None if there is none of this file."""
        if not self._keeps:
            return None
        # an entry of an index takes less than the records that it stands for
        kept = index_cache.load_index(self.path, self._about, self.contents.size)
        try:
            return None if kept is None else self._compared(self._restored(kept))
        except (KeyError, ValueError, TypeError, OverflowError):
            return None

    def _made(self) -> Blocks:
        """A new index, which is kept next to the file."""
        self._unproven = None
        blocks = self._index()
        stamp = self.contents.stamp
        if self._keeps and stamp is not None:
            index_cache.save_index(self.path, self._about, max(stamp[1:3]), self._to_keep(blocks))
        return blocks

    @property
    def _keeps(self) -> bool:
        stamp = self.contents.stamp
        return self.strict and stamp is not None and stamp[0] >= index_cache.LEAST

    @property
    def _about(self) -> dict[str, object]:
        """What a kept index says of the file that it belongs to."""
        size, *stamp = self.contents.stamp or ()
        return {"format": self.format, "block": self.block, "size": size, "stamp": stamp}

    def _to_keep(self, blocks: Blocks) -> dict[str, np.ndarray]:
        """What is kept of an index."""
        return {name: np.asarray(value) for name, value in blocks._asdict().items()}

    def _restored(self, kept: dict[str, np.ndarray]) -> Blocks:
        """The index that was kept. KeyError, ValueError or TypeError if it isn't one of this file."""
        first, last = map(int, kept["span"].tolist())
        times, states = kept["times"], kept["states"]
        count = -(-self.records // self.block)
        shapes = times.shape == (count,), states.shape[:1] == (count,), states.ndim == 2, kept["ordered"].shape == ()
        kinds = times.dtype == np.int64, states.dtype == np.int64, kept["ordered"].dtype == np.bool_
        ordered = bool(kept["ordered"])
        if not all((*shapes, *kinds)) or (ordered and not (is_sorted(times) and first <= last)):
            raise ValueError("an index of another file")
        return Blocks(times, states, ordered, (first, last))

    def _compared(self, blocks: Blocks) -> Blocks:
        """A kept index, after some of its entries were compared with the file. ValueError if one differs."""
        self._unproven = set(range(len(blocks.times)))
        for block in index_cache.entries_to_compare(len(blocks.times)).tolist():
            self._compare(blocks, block)
        return blocks

    def _compare(self, blocks: Blocks, block: int) -> None:
        """Compare an entry of a kept index with the records before and behind it. ValueError if it differs."""
        if self._unproven is None or block not in self._unproven:
            return
        found = self._entry(blocks, block)
        fits = found.time == blocks.times[block] and found.state == blocks.states[block].tolist()
        fits &= block > 0 or found.first in (None, blocks.span[0])
        fits &= block < len(blocks.times) - 1 or found.last in (None, blocks.span[1])
        if not fits:
            raise ValueError("an index of another file")
        self._unproven.discard(block)

    @abstractmethod
    def _entry(self, blocks: Blocks, block: int) -> Entry:
        """The entry of a block, as the records of the block before it and its own give it."""

    def decode_window(self, start: int, stop: int) -> Columns | None:
        if self.strict and self.blocks.ordered and self._unproven:
            try:
                # events before the one and from the other on are left out
                for block in self._touched(start, stop):
                    self._compare(self.blocks, block)
            except ValueError:
                self._blocks = self._made()
        return super().decode_window(start, stop)
