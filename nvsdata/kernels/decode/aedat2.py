"""Conversion of records of AEDAT 2 files to event columns and back."""

from __future__ import annotations

import numpy as np

from nvsdata.kernels import _native

DVS128, DAVIS = 0, 1  # layouts of addresses


def aedat2_decode(
    raw: np.ndarray,
    block: int,
    layout: int,
    chip_width: int,
    chip_height: int,
    width: int,
    height: int,
    state: np.ndarray,
    kept: int,
    t: np.ndarray,
    x: np.ndarray,
    y: np.ndarray,
    p: np.ndarray,
) -> tuple[int, int]:
    """Decode AEDAT 2 records. O(N).

    The arguments and results of a decoder are described in `decode.atis`, and `state` in `decode.clock`. `block` is the
    number of records in a block. `layout`, DVS128 or DAVIS, is the layout of the address bits. x and y are mirrored
    within the chip. Records that are not polarity events are left out.
    """
    sizes = (chip_width, chip_height, width, height)
    found: tuple[int, int] = _native.aedat2_decode(raw, block, layout, *sizes, state, kept, t, x, y, p)
    return found


def aedat2_encode(
    t: np.ndarray, x: np.ndarray, y: np.ndarray, p: np.ndarray, layout: int, chip_width: int, chip_height: int
) -> np.ndarray:
    """Return the AEDAT 2 bytes of events, uint8 [N, 8]. O(N)."""
    records = np.empty(t.size, np.uint64)
    _native.aedat2_encode(t, x, y, p, layout, chip_width, chip_height, records)
    return records.view(np.uint8).reshape(-1, 8)
