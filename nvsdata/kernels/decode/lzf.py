"""LZF, h5py's own compression of HDF5 chunks."""

from __future__ import annotations

import numpy as np

from nvsdata.kernels import _native


def expand_lzf(data: bytes, most: int) -> np.ndarray:
    """Return the first bytes of what LZF data expands to, uint8 [up to `most`]. ValueError if it is damaged."""
    out = np.empty(most, np.uint8)
    size = _native.expand_lzf(np.frombuffer(data, np.uint8), out)
    if size < 0:
        raise ValueError("damaged LZF data")
    return out[:size]
