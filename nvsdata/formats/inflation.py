"""Columns compressed as HDF5's shuffle and gzip do it; and how far compressed data may expand: a few kB that claim
gigabytes are damage, or an attack.
"""

from __future__ import annotations

import numpy as np

try:
    # needs three quarters of zlib's time
    from isal.isal_zlib import IsalError as ZlibError
    from isal.isal_zlib import compress, decompressobj
except ImportError:  # a platform for which isal has no wheel
    from zlib import compress, decompressobj
    from zlib import error as ZlibError

__all__ = ["Allowance", "ZlibError", "decompressobj", "deflated", "most_bytes"]

ALWAYS = 1 << 26  # bytes that any file may expand to
RATIO = 100  # times its size that a larger file may expand to; events compress to a third or a tenth


def most_bytes(size: int) -> int:
    """The most bytes that a compressed file of `size` bytes is allowed to hold."""
    return max(ALWAYS, RATIO * size)


class Allowance:
    """How far the compressed parts of a file of `size` bytes may still inflate, one after the other.

    - `left`: bytes, of those that `most_bytes` allows for all parts together
    """

    def __init__(self, size: int) -> None:
        self.size = size
        self.left = most_bytes(size)

    def of(self, size: int) -> int:
        """The most bytes that a part of `size` bytes is allowed to hold."""
        return min(self.left, most_bytes(size))

    def take(self, count: int) -> None:
        """Subtract `count` bytes. ValueError if there aren't as many left."""
        if count > self.left:
            raise ValueError(f"inflates too far: {self.reason}")
        self.left -= count

    @property
    def reason(self) -> str:
        """What is allowed, as errors state it."""
        return f"a file of {self.size} bytes is taken to hold {most_bytes(self.size)} at most"


def deflated(values: np.ndarray) -> bytes:
    """Values with all their first bytes first, then all their second ones, and so on, as a stream of zlib."""
    apart = values.view(np.uint8).reshape(-1, values.itemsize).T
    # higher levels compress no better: what repeats is single bytes
    return bytes(compress(np.ascontiguousarray(apart), 1))
