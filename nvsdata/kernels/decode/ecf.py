"""ECF, Prophesee's compression of HDF5 chunks of events."""

from __future__ import annotations

import numpy as np

from nvsdata.kernels import _native

# an event as Metavision's files have it
EVENT = np.dtype(
    {"names": ["x", "y", "p", "t"], "formats": ["<u2", "<u2", "<i2", "<i8"], "offsets": [0, 2, 4, 8], "itemsize": 16}
)


def expand_ecf(data: bytes, most: int) -> np.ndarray:
    """Return what ECF data expands to, or `most` bytes without meaning if it is more: uint8 [up to `most`].

    ValueError if the data is damaged.
    """
    words = np.empty(most // EVENT.itemsize * 2, np.uint64)
    count = _native.expand_ecf(np.frombuffer(data, np.uint8), words)
    if count < 0:
        raise ValueError("damaged ECF data")
    size = count * EVENT.itemsize
    return words.view(np.uint8)[:size] if size <= most else np.empty(most, np.uint8)
