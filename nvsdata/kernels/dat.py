"""Bytes of Prophesee .dat to event columns. See `kernels.atis` for what a decoder returns."""

from __future__ import annotations

import numpy as np

from nvsdata.kernels.clock import LAST, WRAP_US, begin, go_evenly, nearest, unwrap
from nvsdata.kernels.compiling import njit

_U = np.uint64


@njit
def dat_decode(raw, block, version, width, height, state, kept, t, x, y, p):
    """Decode Prophesee .dat records. O(N).

    `state` is that of `kernels.clock`, and `block` the number of records in a block.
    """
    words = raw.view(np.uint32)
    size = words.size // 2
    if size == 0:
        return 0, -1
    t, x, y, p = t[kept : kept + size], x[kept : kept + size], y[kept : kept + size], p[kept : kept + size]
    right, bottom = (width, height) if width > 0 else (1 << 14, 1 << 14)
    if version >= 2 and np.int64(words[2 * size - 2]) - np.int64(words[0]) < WRAP_US // 2:
        begin(state, words[0])
        offset = nearest(words[0], state[LAST], 32) - np.int64(words[0])
        first, rest, before = words[:2], words[2:], words[: 2 * size - 2]
        odd = _dat_odd(first, first, offset, right, bottom, t[:1], x[:1], y[:1], p[:1])
        odd += _dat_odd(rest, before, offset, right, bottom, t[1:], x[1:], y[1:], p[1:])
        if odd == 0:
            go_evenly(state, t, block)
            return size, -1
    bad = -1
    for i in range(size):
        address = words[2 * i + 1]
        if version >= 2:
            column = address & 0x3FFF
            row = address >> 14 & 0x3FFF
            p[i] = (address >> 28) & 1
        else:
            column = address & 0x1FF
            row = address >> 9 & 0xFF
            p[i] = address >> 17 & 1
        if width > 0 and (column >= width or row >= height) and bad < 0:
            bad = i
        t[i] = words[2 * i]
        x[i] = column
        y[i] = row
    unwrap(state, t, block)
    return size, bad


@njit
def _dat_odd(words, before, offset, right, bottom, t, x, y, p):
    """Decode version 2 records as if none were odd; returns how many are, or step back from the record `before`."""
    odd = 0
    # no value is carried from one iteration to the next, or the loop would not be vectorized
    for i in range(_U(t.size)):
        time, address = words[_U(2) * i], words[_U(2) * i + _U(1)]
        column = np.int32(address & np.uint32(0x3FFF))
        row = np.int32(address >> np.uint32(14) & np.uint32(0x3FFF))
        odd += (column >= right) | (row >= bottom) | (time < before[_U(2) * i])
        t[i] = np.int64(time) + offset
        x[i] = column
        y[i] = row
        p[i] = address >> np.uint32(28) & np.uint32(1)
    return odd
