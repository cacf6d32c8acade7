"""What AEDAT 4 files consist of: packets, their compression, and the table of them."""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from typing import Any, NamedTuple

import numpy as np

from nvsdata.formats.aedat.flatbuffer import Rows, Table

MAGIC = b"#!AER-DAT4.0\r\n"
PACKET = "<ii"  # stream and size, before each packet's content
HEADER = 8  # bytes of these
EVENT = np.dtype([("t", "<i8"), ("x", "<i2"), ("y", "<i2"), ("on", "u1"), ("unused", "V3")])
LZ4, ZSTD = (1, 2), (3, 4)


class Packets(NamedTuple):
    """Packets as the table at a file's end tells them, each [N].

    - `stream`: number of each one's stream
    - `at`, `size`: first byte of the content, and number of bytes
    - `elements`: number of elements
    - `start`, `end`: times of the first and the last one in µs
    """

    stream: np.ndarray
    at: np.ndarray
    size: np.ndarray
    elements: np.ndarray
    start: np.ndarray
    end: np.ndarray

    def take(self, which: slice | np.ndarray) -> Packets:
        """Some of the packets."""
        return Packets(*(column[which] for column in self))

    def of(self, stream: int) -> Packets | None:
        """The packets of a stream; None if the table doesn't tell how many elements each has."""
        found = self.take(self.stream == stream)
        # some programs write zeros for what they don't know
        return found if found.elements.all() else None

    @property
    def ordered(self) -> bool:
        """Whether each begins no earlier than the one before it ends."""
        return bool((self.start <= self.end).all() and (self.start[1:] >= self.end[:-1]).all())


def packets_of(data: memoryview, first: int, end: int) -> Packets:
    """The packets in an inflated table, which must fill the bytes first..end of the file.

    struct.error or ValueError if the table is broken, or leaves any out.
    """
    rows = Rows(data, *Table.root(data, 4, b"FTAB").vector(0))
    at, elements, start, stop = (rows.column(field, "<i8") for field in (0, 2, 3, 4))
    stream, size = rows.column(1, "<i4"), rows.column(1, "<i4", inside=4).astype(np.int64)
    begin = np.sort(at) - HEADER
    if not np.array_equal(np.append(begin, end), np.append(first, begin + HEADER + size[np.argsort(at)])):
        raise ValueError("a table that doesn't tell all packets")
    return Packets(stream, at, size, elements, start, stop)


def inflater(path: str, compression: int) -> Callable[[memoryview, int], bytes]:
    """What inflates a packet to a number of bytes at most; beyond that, it raises OverflowError.

    ImportError if its package is missing, ValueError for an unknown compression.
    """
    if compression in LZ4:
        lz4 = _package("lz4.frame", f"{path}: ")
        return lambda packet, most: _unlz4(lz4, packet, most)
    if compression in ZSTD:
        zstandard = _package("zstandard", f"{path}: ")
        return lambda packet, most: _unzstd(zstandard, packet, most)
    if compression:
        raise ValueError(f"unknown compression {compression}")
    return lambda packet, _: bytes(packet)


def deflater() -> Callable[[bytes], bytes]:
    """What compresses a packet with LZ4. ImportError if its package is missing."""
    compress = _package("lz4.frame").compress
    return lambda content: bytes(compress(content, content_checksum=True))


def _package(name: str, where: str = "") -> Any:
    try:
        return import_module(name)
    except ImportError as error:
        reason = f"{where}AEDAT 4 needs the packages lz4 and zstandard: pip install 'nvsdata[aedat4]'"
        raise ImportError(reason) from error


def _unlz4(lz4: Any, packet: memoryview, most: int) -> bytes:
    decompressor = lz4.LZ4FrameDecompressor()
    inflated: bytes = decompressor.decompress(packet, max_length=most)
    if decompressor.eof:
        return inflated
    if len(inflated) < most:
        raise ValueError("a packet that is cut short")
    raise OverflowError(f"a packet that inflates to more than {most} bytes")


def _unzstd(zstandard: Any, packet: memoryview, most: int) -> bytes:
    size = zstandard.get_frame_parameters(packet).content_size
    if most < size < (1 << 64) - 2:  # the two largest values mean that it isn't known
        raise OverflowError(f"a packet that inflates to {size} bytes")
    try:
        inflated: bytes = zstandard.ZstdDecompressor().decompress(packet, max_output_size=most)
        return inflated
    except zstandard.ZstdError:
        # of unknown size, damaged, or too long
        if len(zstandard.ZstdDecompressor().stream_reader(packet).read(most + 1)) > most:
            raise OverflowError(f"a packet that inflates to more than {most} bytes") from None
        raise
