"""Columns compressed as HDF5's shuffle and gzip do it; and how far compressed data may expand: a few kB that claim
gigabytes are damage, or an attack.
"""

from __future__ import annotations

import numpy as np

try:
    from isal.isal_zlib import compress
except ImportError:  # a platform for which isal has no wheel
    from zlib import compress

ALWAYS = 1 << 26  # bytes that any file may expand to
RATIO = 100  # times its size that a larger file may expand to; events compress to a third or a tenth


def most_bytes(size: int) -> int:
    """The most bytes that a compressed file of `size` bytes is allowed to hold."""
    return max(ALWAYS, RATIO * size)


def deflated(values: np.ndarray) -> bytes:
    """Values with all their first bytes first, then all their second ones, and so on, as a stream of zlib."""
    apart = values.view(np.uint8).reshape(-1, values.itemsize).T
    # higher levels compress no better: what repeats is single bytes
    return bytes(compress(np.ascontiguousarray(apart), 1))
