"""Order in time."""

from __future__ import annotations

import numpy as np

from nvsdata.kernels.compiling import njit


@njit
def is_sorted(t):
    """Whether no value is smaller than the one before it. O(N), no memory."""
    block = 4096
    for start in range(1, t.size, block):
        falls = 0
        # no exit within a block, so that it is vectorized
        for i in range(np.uint64(start), np.uint64(min(start + block, t.size))):
            falls += t[i] < t[i - np.uint64(1)]
        if falls:
            return False
    return True


@njit
def late(t, most):
    """Indices int64 of the events that come after one with a later time; all -1 if there are more than `most`. O(N)."""
    found = np.empty(most + 1, np.int64)
    count = 0
    latest = t[0] if t.size else 0
    for i in range(t.size):
        if t[i] < latest:
            found[count] = i
            count += 1
            if count > most:
                found[:] = -1
                return found
        else:
            latest = t[i]
    return found[:count]


@njit
def merge_late(late, order, t, x, y, p, t_out, x_out, y_out, p_out):
    """Copy columns, with the `late` events where their times belong, after others of the same time. O(N).

    `order` are the late ones by time; all others are in order of time.
    """
    kept = following = merged = 0
    for i in range(np.uint64(t.size)):
        if following < late.size and late[following] == i:
            following += 1
            continue
        while merged < order.size and t[order[merged]] < t[i]:
            j = order[merged]
            t_out[kept], x_out[kept], y_out[kept], p_out[kept] = t[j], x[j], y[j], p[j]
            kept += 1
            merged += 1
        t_out[kept], x_out[kept], y_out[kept], p_out[kept] = t[i], x[i], y[i], p[i]
        kept += 1
    for j in order[merged:]:
        t_out[kept], x_out[kept], y_out[kept], p_out[kept] = t[j], x[j], y[j], p[j]
        kept += 1


@njit
def stable_order(t):
    """Indices int32 [N] that sort times, equal ones in the order that they have, by digits. O(N) per 11 bits of span.

    `t` int64, fewer than 2^31, of a span below 2^63.
    """
    n = np.uint64(t.size)
    order, other = np.empty(n, np.int32), np.empty(n, np.int32)
    # times move along, because looking them up by index is slow
    key, other_key = np.empty(n, np.uint64), np.empty(n, np.uint64)
    low = t.min() if t.size else 0
    for i in range(n):
        order[i], key[i] = i, t[i] - low
    span = key.max() if t.size else np.uint64(0)
    one, bits, mask = np.uint64(1), np.uint64(11), np.uint64(2047)
    shift = np.uint64(0)
    while shift < 64 and span >> shift:
        begin = np.zeros(2049, np.int64)
        for i in range(n):
            begin[((key[i] >> shift) & mask) + one] += 1
        for digit in range(2048):
            begin[digit + 1] += begin[digit]
        for i in range(n):
            digit = (key[i] >> shift) & mask
            place = np.uint64(begin[digit])
            other[place], other_key[place] = order[i], key[i]
            begin[digit] += 1
        order, other, key, other_key = other, order, other_key, key
        shift += bits
    return order


@njit
def moved(t, moves, sigma, start, end):
    """Times plus `sigma` times `moves` float32 [N], rounded to µs, not before `start` or after `end`: int64 [N]."""
    out = np.empty(t.size, np.int64)
    for i in range(np.uint64(t.size)):
        move = np.rint(np.float64(moves[i]) * sigma)
        # compared before it's added, because it may be beyond int64
        if move >= np.float64(end - t[i]):
            out[i] = end
        elif move <= np.float64(start - t[i]):
            out[i] = start
        else:
            out[i] = t[i] + np.int64(move)
    return out
