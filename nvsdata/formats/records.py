"""Base classes of formats with records of a fixed size: an index of blocks, and windows that use it."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from nvsdata.common.errors import FormatError
from nvsdata.data.events import Columns, check_sensor_size
from nvsdata.formats.contents import PIECE, Contents
from nvsdata.formats.file_recording import FileRecording
from nvsdata.kernels.decode.order import is_sorted


class Blocks(NamedTuple):
    """The index of a file of M blocks.

    Args:
        times: Time in µs of each block's first record (in EVT files, of the last event before the block), int64 [M].
        states: State of the decoder before each block, [M, ...].
        ordered: Whether the times in the file never fall; None if only the first records of blocks were read.
        span: Times in µs of the first and last event, valid if `ordered` is true.
    """

    times: np.ndarray
    states: np.ndarray
    ordered: bool | None = None
    span: tuple[int, int] = (0, 0)


class RecordFile(FileRecording):
    """Records of a fixed size after a header, in order of time unless the file is damaged.

    If not `strict`, the file is always decoded entirely, because a part of a file doesn't show whether it is damaged.
    """

    record_size: int
    block: int  # records per block of the index

    def __init__(
        self, contents: Contents, sensor_size: tuple[int, int] | None, strict: bool, header_size: int = 0
    ) -> None:
        super().__init__(contents.path, sensor_size, strict)
        self.contents = contents
        self.header_size = header_size
        self._blocks: Blocks | None = None
        self.records, torn = divmod(contents.size - header_size, self.record_size)
        if torn and strict:
            reason = f"truncated: {torn} bytes are left over, but a record has {self.record_size}"
            raise FormatError(self.path, reason, offset=contents.size - torn)
        self._repair("bytes of a torn record, cut off", torn)
        contents.drop_head()

    @abstractmethod
    def _index(self) -> Blocks:
        """Compute the index."""

    @abstractmethod
    def _between(self, lo: int, hi: int) -> Columns:
        """Decode records lo..hi; `lo` is the first record of a block."""

    def _check_blocks(self, starts: np.ndarray, lowest: np.ndarray, highest: np.ndarray) -> None:
        """Raise FormatError if events are so far out of order that windows of a few blocks would miss some.

        Args:
            starts: First time of each block.
            lowest: Lowest time of each block.
            highest: Highest time of each block.
        """
        early, late = lowest[1:] < starts[:-1], highest[:-2] > starts[2:]
        # if the blocks themselves are out of order, windows are cut from all events
        if is_sorted(starts) and (early.any() or late.any()):
            where = np.argmax(early) + 1 if early.any() else np.argmax(late)
            reason = f"events are displaced by more than {self.block} records: they are out of order, or damaged"
            raise FormatError(self.path, reason, offset=self._byte(int(where) * self.block))

    def _byte(self, record: int) -> int:
        return self.header_size + record * self.record_size

    def decode(self) -> Columns:
        return self._between(0, self.records)

    @property
    def blocks(self) -> Blocks:
        """The index, computed at its first use."""
        if self._blocks is None:
            self._blocks = self._index()
        return self._blocks

    @property
    def certainly_rises(self) -> bool:
        # a file that doesn't state its sensor is decoded entirely anyway
        return self.strict and self.blocks.ordered is True and self._size is not None

    def decode_span(self) -> tuple[int, int] | None:
        if not self.strict:
            return None
        times, _, ordered, span = self.blocks
        if not self.records or ordered:
            return span
        if ordered is False or not is_sorted(times):
            return None
        # events displaced across the edge of a block may be earlier than the first record, or later than the last
        head = self._between(0, min(2 * self.block, self.records)).t
        tail = self._between((times.size - 2) * self.block, self.records).t if times.size > 2 else head
        if not (head.size and tail.size):
            return None
        first, last = int(head.min()), int(tail.max())
        return (first, last) if times.size < 3 or (first <= times[1] and last >= times[-1]) else None

    def decode_window(self, start: int, stop: int) -> Columns | None:
        """Decode the blocks that overlap the window; return None if they are out of order.

        If the index has only the first records of blocks, one more block is decoded on each side of the window. Events
        that are displaced farther raise a FormatError when the entire file is read.
        """
        if not self.strict:
            return None
        times, _, ordered, _ = self.blocks
        if ordered is False or (ordered is None and not is_sorted(times)):
            return None
        first, last = self._touched(start, stop)
        lo, hi = first * self.block, min(last * self.block, self.records)
        columns = self._between(lo, max(lo, hi))
        t = columns.t
        if not ordered and (not is_sorted(t) or (hi < self.records and t.size and t[-1] > times[last])):
            return None
        a, b = t.searchsorted(start, "left"), t.searchsorted(stop, "left")
        return columns.take(slice(a, b))

    def _touched(self, start: int, stop: int) -> tuple[int, int]:
        """Return the indices of the first block to decode for a window, and of the block after the last."""
        times, _, ordered, _ = self.blocks
        margin = 0 if ordered else 1
        first = int(times.searchsorted(start, "left")) - 1 - margin
        return max(first, 0), int(times.searchsorted(stop, "left")) + margin


class PiecedFile(RecordFile):
    """A file of records that a kernel decodes in pieces; the decoder's state is passed from piece to piece."""

    @abstractmethod
    def _state(self, record: int) -> np.ndarray:
        """Return the decoder's state before `record`, the first record of a block."""

    @abstractmethod
    def _piece(self, raw: np.ndarray, state: np.ndarray, kept: int, columns: Columns) -> tuple[int, int]:
        """Decode the bytes `raw` of some records into the columns from index `kept` on, and update `state`.

        Returns the number of events, and the index in `raw` of the first record outside the sensor or without a valid
        polarity, -1 if there is none.
        """

    def _check(self, state: np.ndarray) -> None:
        """Raise FormatError if `state` shows damage; called after each piece if `strict`."""

    def _most(self, raw: np.ndarray) -> int:
        """Return the number of events for which `_piece` needs space to decode the bytes `raw`."""
        return raw.size // self.record_size

    def _capacity(self, most: int, done: int, total: int) -> int:
        """Return the number of events to allocate for `total` records if the first `done` need space for `most`."""
        return total

    def _pieces(self, lo: int, hi: int) -> Iterator[np.ndarray]:
        """Yield the bytes of records lo..hi in pieces of entire blocks."""
        step = max(PIECE // (self.record_size * self.block), 1) * self.block
        return self.contents.pieces(self._byte(lo), self._byte(hi), step * self.record_size)

    def _run(self, lo: int, hi: int) -> tuple[Columns, np.ndarray]:
        """Decode records lo..hi; return events and the state after them. `lo` is the first record of a block."""
        state = self._state(lo)
        columns: Columns | None = None
        kept, record = 0, lo
        for raw in self._pieces(lo, hi):
            # counted in the bytes in memory, because another process may change the file
            most = kept + self._most(raw)
            if columns is None:
                columns = Columns.empty(self._capacity(most, raw.size // self.record_size, hi - lo))
            elif most > columns.t.size:
                size = self._capacity(most, record - lo + raw.size // self.record_size, hi - lo)
                # one by one, so that only one column is in memory twice
                for name in Columns._fields:
                    columns = columns._replace(**{name: _lengthened(getattr(columns, name), kept, size)})
            count, bad = self._piece(raw, state, kept, columns)
            if self.strict:
                self._check(state)
                if bad >= 0:
                    width, height = self._limits
                    reason = f"coordinates outside the sensor of {width}x{height}, or a polarity other than 0 and 1"
                    raise FormatError(self.path, reason, offset=self._byte(record + bad))
            kept += count
            record += raw.size // self.record_size
        return (Columns.empty(0) if columns is None else columns.first(kept)), state

    def _between(self, lo: int, hi: int) -> Columns:
        return self._run(lo, hi)[0]


def _lengthened(column: np.ndarray, kept: int, size: int) -> np.ndarray:
    """Return a column of `size` events that begins with the first `kept` events of `column`."""
    longer = np.empty(size, column.dtype)
    longer[:kept] = column[:kept]
    return longer


def stated_size(path: str, width: str | int, height: str | int) -> tuple[int, int]:
    """Return the sensor size that a header states. FormatError if it is invalid."""
    try:
        # int() raises ValueError for thousands of digits, too
        return check_sensor_size((int(width), int(height)))
    except ValueError as error:
        raise FormatError(path, f"the header states an invalid sensor size: {str(error)[:200]}", offset=0) from None
