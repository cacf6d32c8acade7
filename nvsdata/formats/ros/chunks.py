"""Chunks of ROS bags: decompression up to a number of bytes, and messages in the records of a chunk.

Damage raises any error, because decompressors have errors of their own.
"""

from __future__ import annotations

import struct
import sys
from importlib import import_module
from typing import Any

MCAP_MESSAGE = 31  # bytes before the data of a message: kind, size, channel, sequence, and two times
Data = bytes | memoryview


def ros1_data(chunk: Data, at: int) -> Data:
    """Return the data of the message whose record begins at a place of a chunk of ROS 1; skip connections before it."""
    for _ in range(len(chunk)):
        (length,) = struct.unpack_from("<I", chunk, at)
        header = bytes(chunk[at + 4 : at + 4 + length])
        (size,) = struct.unpack_from("<I", chunk, at + 4 + length)
        begin = at + 8 + length
        if begin + size > len(chunk):
            raise ValueError(f"states {size} bytes, {len(chunk) - begin} are left in its chunk")
        if b"\4\0\0\0op=\2" in header:
            return chunk[begin : begin + size]
        if b"\4\0\0\0op=\7" not in header:
            break
        at = begin + size
    raise ValueError("no message where the index has one")


def mcap_data(chunk: Data, at: int) -> Data:
    """Return the data of the message whose record begins at a place of a chunk of MCAP."""
    kind, size = struct.unpack_from("<BQ", chunk, at)
    if kind != 5 or size < MCAP_MESSAGE - 9:
        raise ValueError("no message where the index has one")
    if at + 9 + size > len(chunk):
        raise ValueError(f"states {size} bytes, {len(chunk) - at - 9} are left in its chunk")
    return chunk[at + MCAP_MESSAGE : at + 9 + size]


def _unlz4(packed: Data, most: int) -> bytes:
    decompressor = import_module("lz4.frame").LZ4FrameDecompressor()
    return _complete(decompressor, decompressor.decompress(packed, max_length=most), most)


def _unbz2(packed: Data, most: int) -> bytes:
    decompressor = import_module("bz2").BZ2Decompressor()
    return _complete(decompressor, decompressor.decompress(packed, most), most)


def _unzstd(packed: Data, most: int) -> bytes:
    zstd = import_module("compression.zstd" if sys.version_info >= (3, 14) else "backports.zstd")
    decompressor = zstd.ZstdDecompressor()
    return _complete(decompressor, decompressor.decompress(packed, most), most)


def _complete(decompressor: Any, inflated: bytes, most: int) -> bytes:
    if len(inflated) >= most:
        raise ValueError(f"expands to {most} bytes or more, too far")
    if not decompressor.eof:
        raise ValueError("its compressed data are cut off")
    return inflated


INFLATE = {"lz4": _unlz4, "bz2": _unbz2, "zstd": _unzstd}
