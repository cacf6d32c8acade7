"""Bytes to event columns and back, one loop per wire format.

A decoder takes `raw`, uint8, some records of a file, and the `state` before them, which it updates to the state after
them. It fills `t`, `x`, `y`, `p` (int64 µs, int16, int16, uint8) from index `kept` on, where there is room for one
event per record, and returns `(count, bad)`: the number of events, and the index of the first record
whose coordinates lie outside the sensor (-1 if none; a width of 0 means "unknown").
"""

from __future__ import annotations

import numpy as np

from nvsdata.kernels.compiling import njit

BLOCK = 512  # ATIS records that are decoded together
ATIS_OVERFLOW_Y = 240
ATIS_OVERFLOW_US = 1 << 13

_U = np.uint64


# The state of a walk over an ATIS file: µs of overflow in force; times of the last and the first event; the number of
# times that fell; the size of the sensor that the events need; the numbers of overflow records, of all records, and of
# damaged ones, whose y no camera writes; the index of the first damaged one
OVERFLOW, ATIS_LAST, ATIS_FIRST, FALLS, RIGHT, BOTTOM, MARKERS, RECORDS, DAMAGED, DAMAGE = range(10)
ATIS_BEGUN = (0, 0, 0, 0, 1, 1, 0, 0, 0, -1)


@njit
def atis_walk(raw, block, state, times, offsets):
    """Walk over a piece of ATIS records, and update the `state` before them to the state after them. O(N).

    Writes the unwrapped time of every `block`-th record of the file and the µs of overflow in force there.
    """
    n = raw.size // 5
    records = raw.reshape(-1, 5)
    right = bottom = np.uint8(0)
    last = np.int32(0)
    falls = 0
    # branch-free for the usual piece, which has no markers
    for i in range(np.uint64(n)):
        right, bottom = max(right, records[i, 0]), max(bottom, records[i, 1])
        time = np.int32(records[i, 2] & 0x7F) << 16 | np.int32(records[i, 3]) << 8 | np.int32(records[i, 4])
        falls += time < last
        last = time
    begin = state[RECORDS]
    if bottom >= ATIS_OVERFLOW_Y:
        _atis_walk_with_markers(raw, block, state, times, offsets)
    elif n:
        offset = state[OVERFLOW]
        for i in range((block - begin % block) % block, n, block):
            times[(begin + i) // block] = _atis_time(raw, 5 * i) + offset
            offsets[(begin + i) // block, 0] = offset
        first = _atis_time(raw, 0) + offset
        if begin == state[MARKERS] + state[DAMAGED]:
            state[ATIS_FIRST] = state[ATIS_LAST] = first
        state[FALLS] += falls + (first < state[ATIS_LAST])
        state[ATIS_LAST] = np.int64(last) + offset
        state[RIGHT], state[BOTTOM] = max(state[RIGHT], np.int64(right) + 1), max(state[BOTTOM], np.int64(bottom) + 1)
    state[RECORDS] = begin + n


@njit
def _atis_walk_with_markers(raw, block, state, times, offsets):
    begin = state[RECORDS]
    for i in range(raw.size // 5):
        j = 5 * i
        marker, damaged = raw[j + 1] == ATIS_OVERFLOW_Y, raw[j + 1] > ATIS_OVERFLOW_Y
        # a marker's own time has no meaning
        time = state[ATIS_LAST] if marker or damaged else _atis_time(raw, j) + state[OVERFLOW]
        if (begin + i) % block == 0:
            times[(begin + i) // block], offsets[(begin + i) // block, 0] = time, state[OVERFLOW]
        if marker:
            state[OVERFLOW] += ATIS_OVERFLOW_US
            state[MARKERS] += 1
            continue
        if damaged:
            state[DAMAGE] = begin + i if state[DAMAGED] == 0 else state[DAMAGE]
            state[DAMAGED] += 1
            continue
        if begin + i == state[MARKERS] + state[DAMAGED]:
            state[ATIS_FIRST] = state[ATIS_LAST] = time
        state[FALLS] += time < state[ATIS_LAST]
        state[ATIS_LAST] = time
        state[RIGHT] = max(state[RIGHT], np.int64(raw[j]) + 1)
        state[BOTTOM] = max(state[BOTTOM], np.int64(raw[j + 1]) + 1)


@njit(inline="always")
def _atis_time(raw, j):
    return np.int64(raw[j + 2] & 0x7F) << 16 | np.int64(raw[j + 3]) << 8 | np.int64(raw[j + 4])


@njit
def atis_decode(raw, width, height, state, kept, t, x, y, p):
    """Decode a piece of ATIS records. O(N).

    `state` int64 [4]: µs of overflow in force, the numbers of records and of damaged records so far, and the index
    of the first damaged one. Damaged records are left out.
    """
    size = raw.size // 5
    t, x, y, p = t[kept : kept + size], x[kept : kept + size], y[kept : kept + size], p[kept : kept + size]
    offset = state[0]
    right = width if width > 0 else 256
    bottom = min(height, ATIS_OVERFLOW_Y) if height > 0 else ATIS_OVERFLOW_Y
    record = np.empty(BLOCK, np.uint64)
    odd = 0
    # branch-free for the usual piece, in which no record is odd
    for start in range(0, size, BLOCK):
        stop = min(start + BLOCK, size)
        _atis_words(raw[5 * start :], record[: stop - start])
        block = t[start:stop], x[start:stop], y[start:stop], p[start:stop]
        odd += _atis_odd(record[: stop - start], offset, right, bottom, *block)
    begin = state[1]
    state[1] += size
    if odd == 0:
        return size, -1
    count = 0
    bad = -1
    for i in range(size):
        if y[i] == ATIS_OVERFLOW_Y:
            offset += ATIS_OVERFLOW_US
            continue
        if y[i] > ATIS_OVERFLOW_Y:
            state[3] = begin + i if state[2] == 0 else state[3]
            state[2] += 1
            continue
        if width > 0 and (x[i] >= right or y[i] >= bottom) and bad < 0:
            bad = i
        x[count], y[count], p[count] = x[i], y[i], p[i]
        t[count] = _atis_time(raw, 5 * i) + offset
        count += 1
    state[0] = offset
    return count, bad


@njit
def _atis_words(raw, record):
    """The first records of `raw`, each as a word of 8 bytes of which 5 count."""
    # the last record may lack the other three
    whole = min((raw.size - 3) // 5, record.size)
    if whole > 0:
        words = np.lib.stride_tricks.as_strided(raw[:8].view(np.uint64), (whole,), (5,))
        for i in range(_U(whole)):
            record[i] = words[i]
    for i in range(max(whole, 0), record.size):
        record[i] = 0
        for byte in range(5):
            record[i] |= _U(raw[5 * i + byte]) << _U(8 * byte)


@njit
def _atis_odd(record, offset, right, bottom, t, x, y, p):
    """Decode records as if they were events within the sensor; returns how many are not."""
    odd = 0
    for i in range(_U(t.size)):
        word = record[i]
        column, row = np.int32(word & _U(0xFF)), np.int32(word >> _U(8) & _U(0xFF))
        odd += (column >= right) | (row >= bottom)
        t[i] = np.int64(word >> _U(32) & _U(0xFF) | word >> _U(16) & _U(0xFF00) | word & _U(0x7F0000)) + offset
        x[i] = column
        y[i] = row
        p[i] = word >> _U(23) & _U(1)
    return odd


@njit
def atis_encode(t, x, y, p, offset):
    """ATIS bytes of sorted events, with overflow markers as late as possible. O(N + markers).

    `offset`: µs of the markers written before; its new value is also returned.
    """
    offset = np.int64(offset)
    markers = 0
    if t.size and t[-1] - offset >= 1 << 23:
        markers = (t[-1] - offset - (1 << 23)) // ATIS_OVERFLOW_US + 1
    raw = np.empty(5 * (t.size + markers), np.uint8)
    j = 0
    for i in range(t.size):
        while t[i] - offset >= 1 << 23:
            raw[j] = 0
            raw[j + 1] = ATIS_OVERFLOW_Y
            raw[j + 2 : j + 5] = 0xFF
            raw[j + 2] = 0x7F
            offset += ATIS_OVERFLOW_US
            j += 5
        rest = t[i] - offset
        raw[j] = x[i]
        raw[j + 1] = y[i]
        raw[j + 2] = p[i] << 7 | rest >> 16
        raw[j + 3] = rest >> 8 & 0xFF
        raw[j + 4] = rest & 0xFF
        j += 5
    return raw, offset
