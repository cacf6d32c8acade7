"""Conversion of records of Prophesee .dat files to event columns."""

from __future__ import annotations

import numpy as np

from nvsdata.kernels import _native


def dat_decode(
    raw: np.ndarray,
    block: int,
    version: int,
    width: int,
    height: int,
    state: np.ndarray,
    kept: int,
    t: np.ndarray,
    x: np.ndarray,
    y: np.ndarray,
    p: np.ndarray,
) -> tuple[int, int]:
    """Decode Prophesee .dat records. O(N).

    The arguments and results of a decoder are described in `decode.atis`, and `state` in `decode.clock`. `block` is the
    number of records in a block.
    """
    found: tuple[int, int] = _native.dat_decode(raw, block, version, width, height, state, kept, t, x, y, p)
    return found
