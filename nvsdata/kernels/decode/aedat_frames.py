"""Frames among AEDAT 2 records, assembled pixel by pixel."""

from __future__ import annotations

import numpy as np

from nvsdata.kernels import _native

# numbers of a frame: times of its begin, of the begin and end of its exposure, and of its end; its left, top, right
# and bottom edge; and four that only `next_frame` uses
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

    A frame ends before a column that isn't adjacent to the last one, before a pixel that is read again, and at a call
    without records.

    Args:
        addresses: Addresses of the records of pixels, uint32 [N].
        t: Times of the records in µs, int64 [N].
        at: Index of the first record to process.
        before: Readings before the exposure, uint16 [height, width]. This array and the next three keep their contents
            between calls, and must be zero before the first call.
        light: Pixels of the frame, uint16 [height, width].
        state: Number of readings of each pixel, uint8 [height, width].
        facts: Numbers that describe the frame, int64 [FRAME_FACTS].

    Returns:
        Index of the next record to process, and whether a frame is complete. `facts` describes the complete frame, and
        `light` has its pixels.
    """
    found: tuple[int, bool] = _native.next_frame(addresses, t, at, before, light, state, facts)
    return found
