"""Packets of AEDAT 4 files: their layout, their compression, and the table that lists them."""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from typing import Any, NamedTuple

import numpy as np

from nvsdata.formats.aedat.flatbuffer import Rows, Table

MAGIC = b"#!AER-DAT4.0\r\n"
PACKET = "<ii"  # stream and size, before each packet's content
HEADER = 8  # bytes of stream and size
EVENT = np.dtype([("t", "<i8"), ("x", "<i2"), ("y", "<i2"), ("on", "u1"), ("unused", "V3")])
LZ4, ZSTD = (1, 2), (3, 4)
USUAL_RATIO = 4  # by which LZ4 seldom compresses events more


class Packets(NamedTuple):
    """N packets, as the table at a file's end lists them.

    Args:
        stream: Number of each packet's stream, [N].
        at: Byte offset of each packet's content, [N].
        size: Number of bytes of the content, [N].
        elements: Number of elements, such as events, [N].
        start: Time of the first element in µs, [N].
        end: Time of the last element in µs, [N].
    """

    stream: np.ndarray
    at: np.ndarray
    size: np.ndarray
    elements: np.ndarray
    start: np.ndarray
    end: np.ndarray

    def take(self, which: slice | np.ndarray) -> Packets:
        """Return the packets selected by a slice, a boolean mask or indices."""
        return Packets(*(column[which] for column in self))

    def of(self, stream: int) -> Packets | None:
        """Return the packets of a stream; None if the table doesn't state their numbers of elements."""
        found = self.take(self.stream == stream)
        # some programs write zeros for unknown values
        return found if found.elements.all() else None

    @property
    def ordered(self) -> bool:
        """True if each packet starts no earlier than the end of the one before it."""
        return bool((self.start <= self.end).all() and (self.start[1:] >= self.end[:-1]).all())


def packets_of(data: memoryview, first: int, end: int) -> Packets:
    """Return the packets in a decompressed table. They must cover the bytes first..end of the file.

    struct.error or ValueError if the table is damaged or incomplete.
    """
    rows = Rows(data, *Table.root(data, 4, b"FTAB").vector(0))
    at, elements, start, stop = (rows.column(field, "<i8") for field in (0, 2, 3, 4))
    stream, size = rows.column(1, "<i4"), rows.column(1, "<i4", inside=4).astype(np.int64)
    begin = np.sort(at) - HEADER
    if not np.array_equal(np.append(begin, end), np.append(first, begin + HEADER + size[np.argsort(at)])):
        raise ValueError("the table doesn't list all packets")
    return Packets(stream, at, size, elements, start, stop)


def inflater(path: str, compression: int) -> Callable[[memoryview, int], bytes]:
    """Return a function that decompresses a packet; its arguments are the packet and the largest number of bytes.

    The function raises OverflowError if the packet expands to more bytes. `inflater` raises ImportError if the package
    for the compression is missing, and ValueError for an unknown compression.
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
    """Return a function that compresses a packet with LZ4. ImportError if the package lz4 is missing."""
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
    # the package allocates all bytes that a call may return, which takes longer than decompressing
    room = USUAL_RATIO * len(packet)
    inflated: bytes = decompressor.decompress(packet, max_length=min(room, most))
    if not (decompressor.eof or decompressor.needs_input) and len(inflated) < most:
        inflated += decompressor.decompress(b"", max_length=most - len(inflated))
    if decompressor.eof:
        return inflated
    if len(inflated) < most:
        raise ValueError("a packet is truncated")
    raise OverflowError(f"a packet expands to more than {most} bytes")


def _unzstd(zstandard: Any, packet: memoryview, most: int) -> bytes:
    size = zstandard.get_frame_parameters(packet).content_size
    if most < size < (1 << 64) - 2:  # the two largest values mean that the size is unknown
        raise OverflowError(f"a packet expands to {size} bytes")
    try:
        inflated: bytes = zstandard.ZstdDecompressor().decompress(packet, max_output_size=most)
        return inflated
    except zstandard.ZstdError:
        # the packet is of unknown size, damaged, or too long
        if len(zstandard.ZstdDecompressor().stream_reader(packet).read(most + 1)) > most:
            raise OverflowError(f"a packet expands to more than {most} bytes") from None
        raise
