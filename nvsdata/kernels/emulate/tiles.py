"""The tiles that frames are cut into: what doesn't change is left out tile by tile."""

from __future__ import annotations

import numpy as np

from nvsdata.kernels import _native

TILE = (8, 64)  # rows, columns: 64 pixels of 3 bytes are three cache lines


def find_dirty(frame: np.ndarray, previous: np.ndarray, tile_bytes: int, dirty: np.ndarray) -> int:
    """Mark the tiles that differ from the `previous` frame's; return how many. O(bytes).

    Frames are uint8 [H, bytes of a row], `dirty` is bool [tile rows, tile columns].
    """
    count: int = _native.find_dirty(frame, previous, tile_bytes, dirty)
    return count
