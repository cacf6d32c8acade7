"""Compressions of HDF5 chunks: what a chunk expands to, or at least to how many bytes.

Several decoders of plugins trust the lengths inside a chunk, and read the memory behind it. So these are checked, too.
"""

from __future__ import annotations

import bz2
import zlib
from collections.abc import Callable
from typing import Any

import h5py

from nvsdata.formats.contents import fast_zlib
from nvsdata.kernels.decode.ecf import expand_ecf
from nvsdata.kernels.decode.lzf import expand_lzf

SHUFFLE, CHECKSUM = h5py.h5z.FILTER_SHUFFLE, h5py.h5z.FILTER_FLETCHER32
DEFLATE, SZIP, LZF = h5py.h5z.FILTER_DEFLATE, h5py.h5z.FILTER_SZIP, h5py.h5z.FILTER_LZF
# registered with the HDF Group; ECF is Prophesee's
BZIP2, BLOSC, LZ4, BITSHUFFLE, ZSTD, ECF = 307, 32001, 32004, 32008, 32015, 36559
BITS_ONLY = -BITSHUFFLE  # Bitshuffle that doesn't compress
SAME_SIZE = {SHUFFLE, BITS_ONLY}


def filters_of(layout: Any) -> list[tuple[int, tuple[int, ...]]]:
    """Return the filters of a dataset with their settings, in the order of writing, by its creation properties."""
    found = [(kind, values) for kind, _, values, _ in map(layout.get_filter, range(layout.get_nfilters()))]
    # the fifth value is the compression that follows
    return [(BITS_ONLY if kind == BITSHUFFLE and not any(values[4:5]) else kind, values) for kind, values in found]


def inflated(data: bytes, most: int) -> bytes:
    """Return the first bytes of what deflated data expands to, at most `most`. ValueError if it is damaged."""
    # zlib, which the HDF5 library uses, decompresses some data that isal can't
    for library in (fast_zlib, zlib):
        inflater = library.decompressobj()
        try:
            raw: bytes = inflater.decompress(data, most)
        except library.error:
            continue
        if inflater.eof or len(raw) == most:
            return raw
    raise ValueError("damaged or truncated")


def _bunzipped(data: bytes, most: int) -> bytes:
    try:
        return bz2.BZ2Decompressor().decompress(data, most)
    except OSError as error:
        raise ValueError(f"damaged: {error}") from None


def _unzstd(data: bytes, most: int) -> bytes:
    try:
        import zstandard
    except ImportError:
        raise ImportError("data compressed by Zstandard need a package: pip install 'nvsdata[hdf5]'") from None
    try:
        # of a frame that states its size, more than `most` is an error, too
        raw: bytes = zstandard.ZstdDecompressor().decompress(data, max_output_size=most)
    except zstandard.ZstdError as error:
        raise ValueError(f"damaged: {error}") from None
    return raw


# filters that are undone here; the library's decoders of Zstandard and ECF don't notice damage
EXPANDED: dict[int, Callable[[bytes, int], Any]] = {
    DEFLATE: inflated,
    LZF: expand_lzf,
    BZIP2: _bunzipped,
    ZSTD: _unzstd,
    ECF: expand_ecf,
}


def expanded_size(kind: int, settings: tuple[int, ...], data: bytes, most: int) -> int:
    """Return to how many bytes a filter expands data, for some filters `most` if there are more.

    Args:
        kind: Code of the filter.
        settings: Its settings in the file.
        data: What it is to expand.
        most: Largest number of bytes that is of interest.

    Raises:
        ValueError: The data is damaged.
        ImportError: A package for this filter is missing.
        KeyError: Nothing tells the size for this filter.
    """
    if kind in EXPANDED:
        return len(EXPANDED[kind](data, most))
    return _STATED[kind](data, settings)


def _blosc_size(data: bytes, _: tuple[int, ...]) -> int:
    """Return the expanded size in the header, if the compressed size there is true."""
    if int.from_bytes(data[12:16], "little") != len(data):
        raise ValueError("damaged or truncated")
    return int.from_bytes(data[4:8], "little")


def _size_of_blocks(data: bytes, settings: tuple[int, ...] = ()) -> int:
    """Return the expanded size in the header, if the blocks that follow it end with the data."""
    size, block = int.from_bytes(data[:8], "big"), int.from_bytes(data[8:12], "big")
    # of Bitshuffle, the last values, less than eight, follow the blocks as they are
    rest = size % (8 * settings[2]) if settings else 0
    at, left = 12, -(-(size - rest) // block)
    while left and at < len(data):
        at += 4 + int.from_bytes(data[at : at + 4], "big")
        left -= 1
    if left or at + rest != len(data):
        raise ValueError("damaged or truncated")
    return size


_STATED: dict[int, Callable[[bytes, tuple[int, ...]], int]] = {
    SZIP: lambda data, _: int.from_bytes(data[:4], "little"),
    BLOSC: _blosc_size,
    LZ4: lambda data, _: _size_of_blocks(data),
    BITSHUFFLE: _size_of_blocks,
}
KNOWN = {*EXPANDED, *_STATED}
