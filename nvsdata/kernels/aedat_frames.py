"""Frames among AEDAT 2 records, assembled pixel by pixel."""

from __future__ import annotations

import numpy as np

from nvsdata.kernels.compiling import njit

# the facts of a frame: times of its begin, its exposure's begin and end, and its end; its edges; numbers of readings of
# both kinds; the column that was read last, and the direction of columns (1 or -1, 0 if not known yet)
(
    START,
    EXPOSURE_START,
    EXPOSURE_END,
    END,
    LEFT,
    TOP,
    RIGHT,
    BOTTOM,
    BEFORE,
    AFTER,
    COLUMN,
    WAY,
    FRAME_FACTS,
) = range(13)


@njit
def next_frame(addresses, t, at, before, light, state, facts):
    """Process readings from `at` on, up to the first one of the next frame, or to their end. O(N + pixels per frame).

    `addresses` uint32 [N] and `t` int64 [N]: records of pixels. `before` and `light` uint16 [height, width], `state`
    uint8 [height, width] and `facts` int64 are kept between calls. A frame ends where the next column isn't
    the adjacent one, where a pixel is read again, and with a call without records.

    Returns where it stopped, and whether a frame is complete: `facts` describe it, `light` holds its pixels.
    """
    height, width = state.shape
    for i in range(at, addresses.size):
        address = np.int64(addresses[i])
        x, y = address >> 12 & 0x3FF, height - 1 - (address >> 22 & 0x1FF)
        if x >= width or y < 0:
            continue
        value = np.uint16(address & 0x3FF)
        if address >> 10 & 3:
            if state[y, x] != 1:
                continue
            state[y, x] = 2
            light[y, x] = before[y, x] - value if before[y, x] > value else 0
            if facts[AFTER] == 0:
                facts[EXPOSURE_END] = t[i]
            facts[END] = t[i]
            facts[AFTER] += 1
            continue
        step = x - facts[COLUMN]
        if step * step == 1 and facts[WAY] == 0 and facts[BEFORE]:
            facts[WAY] = step
        if state[y, x] or (facts[BEFORE] and step != 0 and step != facts[WAY]):
            # the caller calls again from here, with an empty frame
            if _ended(state, facts):
                return i, True
            state[:] = 0
            facts[:COLUMN] = 0
        facts[COLUMN] = x
        if facts[BEFORE] == 0:
            facts[START] = t[i]
            facts[LEFT], facts[RIGHT], facts[TOP], facts[BOTTOM] = x, x, y, y
        # a rolling shutter reads some pixels a second time before it has read all pixels once
        if facts[AFTER] == 0:
            facts[EXPOSURE_START] = t[i]
        else:
            facts[EXPOSURE_START] = facts[START]
        facts[LEFT], facts[RIGHT] = min(facts[LEFT], x), max(facts[RIGHT], x)
        facts[TOP], facts[BOTTOM] = min(facts[TOP], y), max(facts[BOTTOM], y)
        facts[BEFORE] += 1
        state[y, x] = 1
        before[y, x] = value
    if addresses.size == 0:
        return 0, _ended(state, facts)
    return addresses.size, False


@njit
def _ended(state, facts):
    """Whether the frame so far is complete; resets `state` and the counts for the next frame."""
    area = (facts[RIGHT] + 1 - facts[LEFT]) * (facts[BOTTOM] + 1 - facts[TOP])
    whole = facts[BEFORE] > 0 and facts[BEFORE] == area and facts[AFTER] == area
    if whole:
        state[:] = 0
        facts[BEFORE] = facts[AFTER] = 0
    return whole
