"""Bytes to event columns and back, a loop for each wire format.

A decoder fills `t`, `x`, `y`, `p` (int64 µs, int16, int16, uint8), which have room for an event a record, and
returns `(count, bad)`: how many events there are, and the index of the first record whose coordinates lie outside
the sensor (-1 if none, or `IN_ORDER` if it saw besides that times never fall; a width of 0 means "unknown").
"""

from __future__ import annotations

import numpy as np
from numba import njit

BLOCK = 512  # ATIS records that are decoded at a time
ATIS_OVERFLOW_Y = 240
ATIS_OVERFLOW_US = 1 << 13
IN_ORDER = -2
WRAP_US = 1 << 32  # of a 32-bit counter of µs

_U = np.uint64


@njit(cache=True, nogil=True)
def atis_blocks(raw, block):
    """Walk ATIS records once. O(N).

    Returns the unwrapped time of every `block`-th record (int64), the overflow offset in force
    there (int64), whether times never fall, the first and the last time, the (width, height) that
    the events need, and the number of overflow markers.
    """
    n = raw.size // 5
    records = raw.reshape(-1, 5)
    count = (n + block - 1) // block
    times = np.empty(count, np.int64)
    offsets = np.zeros(count, np.int64)
    right = bottom = np.uint8(0)
    last = np.int32(0)
    falls = 0
    # branch-free for the common file, which has no markers
    for i in range(np.uint64(n)):
        right, bottom = max(right, records[i, 0]), max(bottom, records[i, 1])
        time = np.int32(records[i, 2] & 0x7F) << 16 | np.int32(records[i, 3]) << 8 | np.int32(records[i, 4])
        falls += time < last
        last = time
    if bottom < ATIS_OVERFLOW_Y:
        for b in range(count):
            times[b] = _atis_time(raw, 5 * block * b)
        first = times[0] if n else np.int64(0)
        return times, offsets, falls == 0, (first, np.int64(last)), (int(right) + 1, int(bottom) + 1), 0
    return _atis_blocks_with_markers(raw, block, times, offsets)


@njit(cache=True, nogil=True)
def _atis_blocks_with_markers(raw, block, times, offsets):
    offset = np.int64(0)
    width = height = 1
    markers = falls = 0
    first = last = np.int64(0)
    n = raw.size // 5
    for i in range(n):
        j = 5 * i
        marker = raw[j + 1] == ATIS_OVERFLOW_Y
        # a marker's own time says nothing
        time = last if marker else _atis_time(raw, j) + offset
        if i % block == 0:
            times[i // block], offsets[i // block] = time, offset
        if marker:
            offset += ATIS_OVERFLOW_US
            markers += 1
            continue
        if i == markers:
            first = last = time
        falls += time < last
        last = time
        width, height = max(width, int(raw[j]) + 1), max(height, int(raw[j + 1]) + 1)
    return times, offsets, falls == 0, (first, last), (width, height), markers


@njit(cache=True, nogil=True, inline="always")
def _atis_time(raw, j):
    return np.int64(raw[j + 2] & 0x7F) << 16 | np.int64(raw[j + 3]) << 8 | np.int64(raw[j + 4])


@njit(cache=True, nogil=True)
def atis_decode(raw, lo, hi, offset, width, height, t, x, y, p):
    """Decode ATIS records lo..hi, `offset` µs of overflow being in force at `lo`. O(hi - lo)."""
    size = hi - lo
    right = width if width > 0 else 256
    bottom = min(height, ATIS_OVERFLOW_Y) if height > 0 else ATIS_OVERFLOW_Y
    record = np.empty(BLOCK, np.uint64)
    odd = 0
    # branch-free for the common file, in which no record is odd
    for start in range(0, size, BLOCK):
        stop = min(start + BLOCK, size)
        _atis_words(raw[5 * (lo + start) :], record[: stop - start])
        block = t[start:stop], x[start:stop], y[start:stop], p[start:stop]
        odd += _atis_odd(record[: stop - start], offset, right, bottom, *block)
    if odd == 0:
        return size, -1
    kept = 0
    bad = -1
    for i in range(size):
        if y[i] == ATIS_OVERFLOW_Y:
            offset += ATIS_OVERFLOW_US
            continue
        if width > 0 and (x[i] >= right or y[i] >= bottom) and bad < 0:
            bad = lo + i
        x[kept], y[kept], p[kept] = x[i], y[i], p[i]
        t[kept] = _atis_time(raw, 5 * (lo + i)) + offset
        kept += 1
    return kept, bad


@njit(cache=True, nogil=True)
def _atis_words(raw, record):
    """The records that `raw` begins with, a word of 8 bytes each, of which 5 count."""
    # the last may lack the other three
    whole = min((raw.size - 3) // 5, record.size)
    if whole > 0:
        words = np.lib.stride_tricks.as_strided(raw[:8].view(np.uint64), (whole,), (5,))
        for i in range(_U(whole)):
            record[i] = words[i]
    for i in range(max(whole, 0), record.size):
        record[i] = 0
        for byte in range(5):
            record[i] |= _U(raw[5 * i + byte]) << _U(8 * byte)


@njit(cache=True, nogil=True)
def _atis_odd(record, offset, right, bottom, t, x, y, p):
    """Decode records as if they were events within the sensor; how many are not."""
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


@njit(cache=True, nogil=True)
def atis_encode(t, x, y, p, offset):
    """ATIS bytes of sorted events, overflow markers put in as late as they can be. O(N + markers).

    `offset`: µs of the markers written before; the new value is returned, too.
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


@njit(cache=True, nogil=True)
def dat_decode(words, lo, hi, offset, version, width, height, t, x, y, p):
    """Decode Prophesee .dat records lo..hi. O(hi - lo).

    `words` uint32 [2 N], time and address in turns; `offset` µs of wraps in force at `lo`. A step back of
    more than 2^31 µs is a wrap of the 32-bit counter; a smaller one is disorder and stays.
    """
    size = hi - lo
    right, bottom = (width, height) if width > 0 else (1 << 14, 1 << 14)
    if version >= 2 and size:
        first, rest, before = words[2 * lo : 2 * lo + 2], words[2 * lo + 2 : 2 * hi], words[2 * lo : 2 * hi - 2]
        odd = _dat_odd(first, first, offset, right, bottom, t[:1], x[:1], y[:1], p[:1])
        odd += _dat_odd(rest, before, offset, right, bottom, t[1:], x[1:], y[1:], p[1:])
        if odd == 0:
            return size, IN_ORDER
    bad = -1
    last = np.int64(words[2 * lo]) if size else np.int64(0)
    for i in range(lo, hi):
        k = i - lo
        time = np.int64(words[2 * i])
        if last - time > WRAP_US // 2:
            offset += WRAP_US
        last = time
        address = words[2 * i + 1]
        if version >= 2:
            column = address & 0x3FFF
            row = address >> 14 & 0x3FFF
            p[k] = (address >> 28) & 1
        else:
            column = address & 0x1FF
            row = address >> 9 & 0xFF
            p[k] = address >> 17 & 1
        if width > 0 and (column >= width or row >= height) and bad < 0:
            bad = i
        t[k] = time + offset
        x[k] = column
        y[k] = row
    return size, bad


@njit(cache=True, nogil=True)
def _dat_odd(words, before, offset, right, bottom, t, x, y, p):
    """Decode version 2 records as if none were odd; how many are, or step back from those `before` them."""
    odd = 0
    # no value is carried from turn to turn, or the loop would not be vectorised
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
