"""A precomputed sample in a store: its checksum, and the bytes of `encode_sample` (`docs/dev/store.md`)."""

from __future__ import annotations

import struct
import zlib
from typing import Any

import numpy as np

from nvsdata.datasets.cache.encoding import MOST, decode_sample, encode_sample
from nvsdata.datasets.store.index import ALIGNED
from nvsdata.kernels.decode.blocks import crc32c

try:
    from isal import isal_zlib
except ImportError:  # isal isn't available for every processor
    isal_zlib = zlib

# checksum of the rest; bytes that follow; bytes of the sample, which are compressed if it has more than follow
HEAD = struct.Struct("<IIQ")
SAMPLE_HEAD = HEAD.size  # bytes
LEVEL = 2  # of deflate: edges take 4% less than with level 1
SAVED = 0.75  # samples that deflate doesn't make smaller than this fraction aren't compressed, which reads faster


def sample_record(sample: Any) -> bytes:
    """Return the bytes of a sample's record.

    Raises:
        TypeError: it isn't made of Events, graphs, tensors, arrays, numbers, strings, and tuples, lists, dicts of them.
        TooLarge: it takes more than 1 GiB.
    """
    content = encode_sample(sample)
    stored: bytes = isal_zlib.compress(content, LEVEL)
    if len(stored) > SAVED * len(content):
        stored = content
    rest = HEAD.pack(0, len(stored), len(content))[4:] + stored
    check = struct.pack("<I", crc32c(np.frombuffer(rest, np.uint8)))
    return check + rest + bytes(-len(check + rest) % ALIGNED)


def sample_of(raw: np.ndarray, check: int) -> Any:
    """Return the sample of a record, uint8.

    Raises:
        ValueError: the record is damaged, or `check` isn't its checksum.
    """
    if raw.size < HEAD.size:
        raise ValueError("a sample is cut short")
    stated, length, size = HEAD.unpack_from(raw.data)
    end = HEAD.size + length
    if not end <= raw.size < end + ALIGNED or crc32c(raw[4:end]) != stated:
        raise ValueError("a sample fails its checksum: precompute it again")
    if stated != check:
        raise ValueError("a sample isn't that of the index: the store has changed since it was opened")
    stored = raw[HEAD.size : end].data
    return decode_sample(stored if length == size else _inflated(stored, size))


def used_bytes(raw: np.ndarray) -> int:
    """Return the size of a sample's record without the bytes that fill it up, from its first `SAMPLE_HEAD` bytes."""
    _, length, _ = HEAD.unpack_from(raw.data)
    return SAMPLE_HEAD + int(length)


def _inflated(stored: memoryview, size: int) -> memoryview:
    """Return the `size` bytes that were compressed. ValueError if there are fewer or more."""
    inflating = isal_zlib.decompressobj()
    try:
        if not len(stored) < size <= MOST:
            raise ValueError("a sample states an impossible size")
        content = inflating.decompress(stored, size)
        # the end of the stream may follow
        more = inflating.decompress(inflating.unconsumed_tail, 1)
    except (zlib.error, isal_zlib.error) as error:
        raise ValueError(f"a sample can't be decompressed: {error}") from None
    if len(content) != size or more or not inflating.eof or inflating.unused_data:
        raise ValueError("a sample ends before or after its bytes")
    return memoryview(content)
