"""What formats with records of a fixed size share: an index of blocks, and windows by it."""

from __future__ import annotations

import mmap
import re
from abc import abstractmethod
from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numpy as np

from nvsdata.errors import FormatError
from nvsdata.events import Columns, Events, Recording
from nvsdata.kernels.decode import IN_ORDER, WRAP_US
from nvsdata.kernels.order import never_falls

LAST_LINES = ("#end of ascii header", "#!end-header", "% end")  # a header ends here whatever follows
# an AEDAT record may begin with the mark by chance; Prophesee's hardly do, but their headers may hold foreign names
_PRINTABLE = {b"#": re.compile(rb"[\t\r\x20-\x7e]*"), b"%": re.compile(rb"[\t\r\x20-\x7e\x80-\xff]*")}
HEAD = 1 << 16  # bytes that are read to tell the format; less than that is a whole file


class Blocks(NamedTuple):
    """Time of every block's first record and the µs to add to raw times there, both int64.

    `ordered` says whether times never fall, None if only the first records of blocks were looked
    at; `span` is the first and the last time of those that are known to be in order.
    """

    times: np.ndarray
    offsets: np.ndarray
    ordered: bool | None = None
    span: tuple[int, int] = (0, 0)


class RecordFile(Recording):
    """Fixed-size records after a header, in order of time unless the file is broken."""

    record_size: int
    block: int  # records between two entries of the index

    def __init__(
        self, path: str, sensor_size: tuple[int, int] | None, head: bytes, strict: bool, header_size: int = 0
    ) -> None:
        super().__init__(path, sensor_size, strict)
        self.header_size = header_size
        self._raw = np.frombuffer(bytes_of(path, head), np.uint8, offset=header_size)
        self._blocks: Blocks | None = None
        torn = self._raw.size % self.record_size
        if torn:
            whole = self._raw.size - torn
            if strict:
                reason = f"truncated: {torn} bytes are left over, a record takes {self.record_size}"
                raise FormatError(path, header_size + whole, reason)
            self._raw = self._raw[:whole]
            self._repair("bytes of a torn record, cut off", torn)

    @property
    def records(self) -> int:
        """Number of records in the file."""
        return int(self._raw.size // self.record_size)

    @abstractmethod
    def _index(self) -> Blocks:
        """The index of blocks."""

    @abstractmethod
    def _records(self, lo: int, hi: int, offset: int) -> tuple[Columns, int]:
        """Events of records lo..hi, `offset` µs being in force at lo; and the first bad record, -1, or `IN_ORDER`."""

    def _between(self, lo: int, hi: int, offset: int) -> Columns:
        columns, bad = self._records(lo, hi, offset)
        self._rises = bad == IN_ORDER
        if bad >= 0 and self.strict:
            width, height = self.sensor_size
            where = self.header_size + bad * self.record_size
            raise FormatError(self.path, where, f"coordinates outside the sensor of {width}x{height}")
        return columns

    def _decode(self) -> Columns:
        return self._between(0, self.records, 0)

    @property
    def blocks(self) -> Blocks:
        """The index, made at its first use."""
        if self._blocks is None:
            self._blocks = self._index()
        return self._blocks

    def _bounds(self) -> tuple[int, int] | None:
        times, offsets, ordered, span = self.blocks
        if not self.records or ordered:
            return span
        if ordered is False or not never_falls(times):
            return None
        head = self._between(0, min(self.block, self.records), 0).t
        tail = self._between((times.size - 1) * self.block, self.records, int(offsets[-1])).t
        if not (head.size and tail.size and never_falls(head) and never_falls(tail)):
            return None
        return int(head[0]), int(tail[-1])

    def _window(self, start: int, stop: int) -> Columns | None:
        """Decode the blocks that the window touches; None if they are in disorder.

        If only the blocks' first records are known, one more block is decoded on each side: events
        that strayed further show in the index, or only when the whole is read.
        """
        times, offsets, ordered, _ = self.blocks
        if ordered is False or (ordered is None and not never_falls(times)):
            return None
        margin = 0 if ordered else 1
        first = max(int(times.searchsorted(start, "left")) - 1 - margin, 0)
        last = int(times.searchsorted(stop, "left")) + margin
        lo, hi = first * self.block, min(last * self.block, self.records)
        columns = self._between(lo, max(lo, hi), int(offsets[first]) if offsets.size else 0)
        t = columns.t
        if not ordered and (not never_falls(t) or (hi < self.records and t.size and t[-1] > times[last])):
            return None
        a, b = t.searchsorted(start, "left"), t.searchsorted(stop, "left")
        return columns.at(slice(a, b))


def bytes_of(path: str, head: bytes) -> bytes | mmap.mmap:
    """The whole file: `head` if that is all of it, else a memory map."""
    if len(head) < HEAD:
        return head
    with open(path, "rb") as file:
        return mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)


def all_bytes_of(path: str, head: bytes) -> bytes:
    """The whole file in memory: for formats that need all of it, a read is cheaper than a map's pages."""
    if len(head) < HEAD:
        return head
    with open(path, "rb", buffering=0) as file:
        file.seek(len(head))
        return head + file.read()


def unwrapped_index(raw: np.ndarray) -> Blocks:
    """Index from the raw 32-bit times of the blocks' first records; a fall of more than 2^31 µs is a wrap."""
    times = raw.astype(np.int64)
    offsets = np.zeros_like(times)
    np.cumsum(times[:-1] - times[1:] > WRAP_US // 2, out=offsets[1:])
    offsets *= WRAP_US
    return Blocks(times + offsets, offsets)


def with_times_of_32_bits(pieces: Iterable[Events], name: str) -> Iterator[Events]:
    """The pieces; ValueError where a reader could not unwrap times: a first one beyond 32 bits, or a gap of 2^31 µs."""
    last = None
    for events in pieces:
        t = events.t
        # the first time is bounded as a step from 0 is, but by a whole wrap
        first = t[:1] - last if last is not None else t[:1] // 2
        if t[0] < 0 or max(first.max(), np.diff(t).max(initial=0)) >= WRAP_US // 2:
            raise ValueError(f"{name} holds a first time below 2^32 µs and gaps below 2^31 µs only")
        last = t[-1]
        yield events


def header_lines(head: bytes | mmap.mmap, mark: bytes) -> tuple[list[str], int]:
    """The lines at the start that begin with `mark` and are printable, and the byte after them."""
    lines: list[str] = []
    end = 0
    while head[end : end + len(mark)] == mark:
        newline = head.find(b"\n", end)
        line = head[end:newline] if newline >= 0 else b"\0"
        if not _PRINTABLE[mark].fullmatch(line):
            break
        lines.append(line.decode("latin-1").rstrip("\r"))
        end = newline + 1
        if lines[-1].lower() in LAST_LINES:
            break
    return lines, end
