"""A recording in a packed store: its head, its table of blocks, and the blocks of its events (`docs/dev/store.md`)."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from nvsdata.data.events import Columns
from nvsdata.datasets.store.index import ALIGNED
from nvsdata.kernels.decode.blocks import DAMAGES, FAULTS, crc32c, record_head, unpack_blocks

try:
    from isal import isal_zlib
except ImportError:  # isal isn't available for every processor
    isal_zlib = zlib

# checksum; blocks; events; base, duration, begin and end in µs; width, height; bytes of a time and of a coordinate;
# compression; whether the file states no sensor size; format of the packed file
HEAD = struct.Struct("<IIQqqqqHHBBBB16s")
GUESSED = 55  # offset of the byte on the sensor size
BLOCK = np.dtype([("first", "<i8"), ("events", "<u4"), ("bytes", "<u4"), ("check", "<u4"), ("zero", "<u4")])
NAME = 16  # bytes of a format's name
MOST_EVENTS = 1 << 16  # of a block
UNSTATED = np.iinfo(np.int64).min  # in place of beginning and end of a recording whose file doesn't state them
NARROW = np.iinfo(np.uint32).max
LEVEL = 1  # of deflate
MOST_RATIO = 100  # bytes of events for a byte of a compressed block
_TIMES = {4: "<u4", 8: "<i8"}
NO_BYTES = np.zeros(0, np.uint8)


class Head(NamedTuple):
    """Head of a record: the facts that a store states of a recording before its events.

    Attributes:
        span: times of the first and the last event in µs.
        time: beginning and end in µs as the packed file stated them, or (None, None).
        size: sensor size (width, height) in pixels.
        start: the bytes before the table, uint8.
        table: table of the blocks, uint8.
        widths: bytes of a time and of a coordinate.
        compressed: whether the blocks are compressed.
        guessed: whether the size is guessed from the events, because the packed file states none.
    """

    span: tuple[int, int]
    time: tuple[int, int] | tuple[None, None]
    size: tuple[int, int]
    start: np.ndarray
    table: np.ndarray
    widths: tuple[int, int]
    compressed: bool
    guessed: bool = False

    @property
    def format(self) -> str:
        """Format of the packed file."""
        return self.start[-NAME:].tobytes().rstrip(b"\0").decode("ascii", "replace")

    @property
    def check(self) -> int:
        """Checksum of head and table, which has the blocks' checksums."""
        return int.from_bytes(self.start[:4].tobytes(), "little")

    @property
    def bytes(self) -> int:
        """Size of head and table."""
        return HEAD.size + self.table.size

    @property
    def blocks(self) -> np.ndarray:
        """The table, structured array of `BLOCK`."""
        return self.table.view(BLOCK)


def record_of(
    columns: Columns,
    size: tuple[int, int],
    time: tuple[int, int] | tuple[None, None],
    file_format: str,
    *,
    compress: bool,
    guessed: bool = False,
) -> bytes:
    """Return a recording, with at least one event, as the bytes of its record."""
    base, last = int(columns.t[0]), int(columns.t[-1])
    widths = 4 if last - base <= NARROW else 8, 1 if max(size) <= 256 else 2
    xy = f"<u{widths[1]}"
    kinds = (_TIMES[widths[0]], xy, xy, "u1")
    stored = [columns.t - base, columns.x, columns.y, columns.p]
    stored = [values.astype(np.dtype(kind)) for values, kind in zip(stored, kinds, strict=True)]
    starts = range(0, columns.t.size, MOST_EVENTS)
    plain = [[values[start : start + MOST_EVENTS] for values in stored] for start in starts]
    blocks = [b"".join(part.tobytes() for part in block) for block in plain]
    if compress:
        packed = [isal_zlib.compress(_shuffled(block), LEVEL) for block in plain]
        # a store's reader refuses blocks that are compressed more
        compress = all(len(one) * MOST_RATIO >= len(other) for one, other in zip(packed, blocks, strict=True))
        blocks = packed if compress else blocks
    table = np.zeros(len(blocks), BLOCK)
    table["first"], table["events"] = stored[0][::MOST_EVENTS], [block[0].size for block in plain]
    table["bytes"] = [len(block) for block in blocks]
    table["check"] = [crc32c(np.frombuffer(block, np.uint8)) for block in blocks]
    stated = (UNSTATED, UNSTATED) if time[0] is None else time
    numbers = (len(blocks), columns.t.size, base, last - base, *stated, *size, *widths, int(compress), int(guessed))
    head = HEAD.pack(0, *numbers, file_format.encode())[4:] + table.tobytes()
    padding = bytes(-sum(map(len, (*blocks, head)), 4) % ALIGNED)
    del stored, plain
    return b"".join((struct.pack("<I", crc32c(np.frombuffer(head, np.uint8))), head, *blocks, padding))


def _shuffled(block: list[np.ndarray]) -> bytes:
    """Return a block for compression: differences of times, and of each column the first bytes, then the second ones.

    Polarities are bits.
    """
    t, x, y, p = block
    parts = [np.diff(t, prepend=t[:1]), x, y]
    planes = [np.ascontiguousarray(part.view(np.uint8).reshape(part.size, -1).T) for part in parts]
    return b"".join(part.tobytes() for part in (*planes, np.packbits(p)))


def _unshuffled(raw: bytes, head: Head, block: np.void) -> np.ndarray:
    """Return the bytes of the block that `_shuffled` changed; ValueError if there are more or fewer."""
    count, (t_width, xy_width) = int(block["events"]), head.widths
    sizes = [count * t_width, count * xy_width, count * xy_width, -(-count // 8)]
    flat = np.frombuffer(raw, np.uint8)
    if flat.size != sum(sizes):
        raise ValueError("they have another length than their number")
    *planes, bits = np.split(flat, np.cumsum(sizes)[:-1])
    delta, x, y = (np.ascontiguousarray(plane.reshape(-1, count).T).reshape(-1) for plane in planes)
    t = delta.view(_TIMES[t_width])
    if t[0]:
        raise ValueError("their times don't begin at that of the table")
    t = np.cumsum(t, dtype=t.dtype)
    t += t.dtype.type(block["first"])
    p = np.unpackbits(bits, count=count)
    whole: np.ndarray = np.concatenate([t.view(np.uint8), x, y, p])
    return whole


def head_of(raw: np.ndarray, room: int) -> Head:
    """Return the head at the beginning of a record of `room` bytes, of which `raw` has at least head and table.

    Raises:
        ValueError: the head is damaged, or states what can't be.
    """
    damage, blocks, base, duration, begin, end, width, height, t, xy, compressed = record_head(raw, room)
    if damage:
        raise ValueError(DAMAGES[damage - 1])
    time = (None, None) if begin == UNSTATED else (begin, end)
    table = raw[HEAD.size : HEAD.size + BLOCK.itemsize * blocks]
    sides, widths = (width, height), (t, xy)
    return Head(
        (base, base + duration), time, sides, raw[: HEAD.size], table, widths, bool(compressed), bool(raw[GUESSED])
    )


def events_of(head: Head, first: int, last: int, raw: np.ndarray, start: int, stop: int, most: int) -> Columns:
    """Return the events with start <= t < stop (µs) of blocks `first` to `last` - 1, whose bytes are `raw`.

    `most` is the number of events of these blocks.

    Raises:
        BlockError: a block is damaged or has impossible events.
    """
    table = head.table[first * BLOCK.itemsize : last * BLOCK.itemsize]
    if head.compressed:
        raw = np.concatenate([NO_BYTES, *_inflated(head, first, last, raw)])
    columns = Columns.empty(most)
    check = not head.compressed
    found, fault = unpack_blocks(*columns, head.span[0], start, stop, raw, table, check, *head.widths, *head.size)
    if fault:
        block, reason = divmod(fault - 1, 4)
        raise BlockError(first + block, FAULTS[reason])
    return columns.first(found)


def _inflated(head: Head, first: int, last: int, raw: np.ndarray) -> Iterator[np.ndarray]:
    """Yield the bytes of compressed blocks."""
    at = 0
    for number in range(first, last):
        block = head.blocks[number]
        own = raw[at : at + int(block["bytes"])]
        at += own.size
        if crc32c(own) != block["check"]:
            raise BlockError(number, FAULTS[0])
        most = int(block["events"]) * (head.widths[0] + 2 * head.widths[1] + 1)
        try:
            inflating = isal_zlib.decompressobj()
            plain = inflating.decompress(own, most)
            if not inflating.eof or inflating.unused_data:
                raise ValueError("they end before or after their bytes")
            yield _unshuffled(plain, head, block)
        except (ValueError, zlib.error, isal_zlib.error) as error:
            raise BlockError(number, f"its events can't be decompressed: {error}") from None


class BlockError(ValueError):
    """A block of a recording, by its number, that is damaged."""

    def __init__(self, block: int, reason: str) -> None:
        self.block = block
        super().__init__(reason)

    def at(self, head: Head) -> int:
        """Return the first byte of the block, counted from the beginning of the record with this head."""
        return head.bytes + int(head.blocks["bytes"][: self.block].sum())
