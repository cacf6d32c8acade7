"""Frames among AEDAT 2 records, assembled pixel by pixel."""

from __future__ import annotations

import numpy as np

from nvsdata.kernels import _native

# numbers of a frame: times of its begin, its exposure's begin and end, and its end; its left, top, right and bottom
# edge; and four that only `next_frame` knows
FRAME_FACTS = 12


def next_frame(
    addresses: np.ndarray,
    t: np.ndarray,
    at: int,
    before: np.ndarray,
    light: np.ndarray,
    state: np.ndarray,
    facts: np.ndarray,
) -> tuple[int, bool]:
    """Process readings from `at` on, up to the first one of the next frame, or to their end. O(N + pixels per frame).

    A frame ends where the next column isn't the adjacent one, where a pixel is read again, and with a call without
    records.

    Args:
        addresses: uint32 [N], of records of pixels.
        t: int64 [N].
        at: index of the first record.
        before: uint16 [height, width], kept between calls, like all that follow; zeros at first.
        light: uint16 [height, width].
        state: uint8 [height, width].
        facts: int64 [FRAME_FACTS].

    Returns:
        The record it stopped at, and whether a frame is complete: `facts` describe it, `light` contains its pixels.
    """
    found: tuple[int, bool] = _native.next_frame(addresses, t, at, before, light, state, facts)
    return found
