"""Files of records whose index needs a pass over the entire file, and is cached next to it."""

from __future__ import annotations

from abc import abstractmethod
from typing import NamedTuple

import numpy as np

from nvsdata.data.events import Columns
from nvsdata.formats import index_cache
from nvsdata.formats.records import Blocks, PiecedFile
from nvsdata.kernels.decode.order import is_sorted


class Entry(NamedTuple):
    """The entry of one block in an index, computed from the records of that block and the block before it.

    Args:
        time: Entry in `Blocks.times`.
        state: Entry in `Blocks.states`.
        first: Time in µs of the first event of these records; None if they contain no event.
        last: Time in µs of the last event of these records; None if they contain no event.
    """

    time: int
    state: list[int]
    first: int | None
    last: int | None


class IndexedFile(PiecedFile):
    """A file whose index is cached if the file is large.

    Some entries of a cached index are compared with the file when the index is loaded. The entries at the ends of a
    window are compared when the window is decoded. If an entry differs, the index is computed again.
    """

    _unchecked: set[int] | None = None  # blocks of a cached index whose entries weren't compared with the file yet

    @property
    def blocks(self) -> Blocks:
        """The index, from the cache or computed at its first use."""
        if self._blocks is None:
            self._blocks = self._cached() or self._computed()
        return self._blocks

    def _cached(self) -> Blocks | None:
        """Return the cached index; None if this file has no valid one."""
        if not self._caches:
            return None
        # the index is smaller than the file
        kept = index_cache.load_index(self.path, self._about, self.contents.size)
        try:
            return None if kept is None else self._compared(self._restored(kept))
        except (KeyError, ValueError, TypeError, OverflowError):
            return None

    def _computed(self) -> Blocks:
        """Compute the index, and cache it."""
        self._unchecked = None
        blocks = self._index()
        stamp = self.contents.stamp
        if self._caches and stamp is not None:
            index_cache.save_index(self.path, self._about, max(stamp[1:3]), self._to_cache(blocks))
        return blocks

    @property
    def _caches(self) -> bool:
        stamp = self.contents.stamp
        return self.strict and stamp is not None and stamp[0] >= index_cache.LEAST

    @property
    def _about(self) -> dict[str, object]:
        """Description of the file that an index belongs to."""
        size, *stamp = self.contents.stamp or ()
        return {"format": self.format, "block": self.block, "size": size, "stamp": stamp}

    def _to_cache(self, blocks: Blocks) -> dict[str, np.ndarray]:
        """Return the arrays to cache for an index, by name."""
        return {name: np.asarray(value) for name, value in blocks._asdict().items()}

    def _restored(self, kept: dict[str, np.ndarray]) -> Blocks:
        """Return the index made of cached arrays. KeyError, ValueError or TypeError if they don't fit this file."""
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
        """Compare some entries of a cached index with the file, and return it. ValueError if one differs."""
        self._unchecked = set(range(len(blocks.times)))
        for block in index_cache.entries_to_compare(len(blocks.times)).tolist():
            self._compare(blocks, block)
        return blocks

    def _compare(self, blocks: Blocks, block: int) -> None:
        """Compare an entry of a cached index with the records around it. ValueError if it differs."""
        if self._unchecked is None or block not in self._unchecked:
            return
        found = self._entry(blocks, block)
        fits = found.time == blocks.times[block] and found.state == blocks.states[block].tolist()
        fits &= block > 0 or found.first in (None, blocks.span[0])
        fits &= block < len(blocks.times) - 1 or found.last in (None, blocks.span[1])
        if not fits:
            raise ValueError("an index of another file")
        self._unchecked.discard(block)

    @abstractmethod
    def _entry(self, blocks: Blocks, block: int) -> Entry:
        """Return the entry of a block, computed from the records of that block and the block before it."""

    def decode_window(self, start: int, stop: int) -> Columns | None:
        if self.strict and self.blocks.ordered and self._unchecked:
            try:
                # if these two entries are right, all events of the window are between their blocks
                for block in self._touched(start, stop):
                    self._compare(self.blocks, block)
            except ValueError:
                self._blocks = self._computed()
        return super().decode_window(start, stop)
