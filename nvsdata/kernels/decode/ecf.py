"""ECF, Prophesee's compression of HDF5 chunks of events."""

from __future__ import annotations

import numpy as np

from nvsdata.kernels import _native

EVENT = 16  # bytes of an event: x, y and polarity of 2 each, 2 unused ones, and the time


def expand_ecf(data: bytes, most: int) -> np.ndarray:
    """Return what ECF data expands to, or `most` bytes without meaning if it is more: uint8 [up to `most`].

    ValueError if the data is damaged.
    """
    words = np.empty(most // EVENT * 2, np.uint64)
    count = _native.expand_ecf(np.frombuffer(data, np.uint8), words)
    if count < 0:
        raise ValueError("damaged ECF data")
    return words.view(np.uint8)[: count * EVENT] if count * EVENT <= most else np.empty(most, np.uint8)
