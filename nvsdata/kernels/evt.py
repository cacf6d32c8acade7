"""Prophesee EVT2 and EVT3 words to event columns.

Both formats send the high bits of the time in words of their own, so a walk over all words finds
the state in force at each block of words; a window then decodes only its blocks. See `kernels.decode` for what a
decoder takes and returns; EVT3's columns have room for the events that its states count.
"""

from __future__ import annotations

import numpy as np
from numba import njit

EVT2_OFF, EVT2_ON, EVT2_TIME = 0x0, 0x1, 0x8
EVT3_Y, EVT3_X, EVT3_BASE, EVT3_VECTOR_12, EVT3_VECTOR_8, EVT3_LOW, EVT3_HIGH = 0x0, 0x2, 0x3, 0x4, 0x5, 0x6, 0x8
NO_TIME = -1  # before the first word with high bits: events there have no time


@njit(cache=True, nogil=True)
def evt2_states(words, block):
    """Walk the words once. O(N). Returns, for every `block`-th word,

    - the high part of the time in force there, in µs (int64 [M], wraps at 2^34 µs added),
    - the time of the last event before it (int64 [M], -1 if there is none);

    then whether times never fall, and the first and the last time.
    """
    count = (words.size + block - 1) // block
    states, times = np.empty(count, np.int64), np.empty(count, np.int64)
    high = last = first = np.int64(NO_TIME)
    falls = 0
    for i in range(words.size):
        if i % block == 0:
            states[i // block], times[i // block] = high, last
        kind = words[i] >> 28
        if kind == EVT2_TIME:
            high = _next_high(high, np.int64(words[i] & 0xFFFFFFF), 28, 6)
        elif kind <= EVT2_ON and high >= 0:
            time = high + np.int64(words[i] >> 22 & 0x3F)
            falls += time < last
            last = time
            if first < 0:
                first = time
    return states, times, falls == 0, (max(first, 0), max(last, 0))


@njit(cache=True, nogil=True, inline="always")
def _next_high(before, raw, bits, shift):
    """The high part that `raw` (of `bits` bits) stands for, in µs: a fall of over half its range is a wrap."""
    if before < 0:
        return raw << shift
    wraps = before >> (bits + shift)
    last = (before >> shift) & ((1 << bits) - 1)
    if last - raw > 1 << (bits - 1):
        wraps += 1
    return (wraps << (bits + shift)) | raw << shift


@njit(cache=True, nogil=True)
def evt2_decode(words, lo, hi, high, width, height, t, x, y, p):
    """Decode words lo..hi, `high` being in force at `lo`. O(hi - lo)."""
    bad = -1
    kept = np.uint64(0)
    right, bottom = (width, height) if width > 0 else (1 << 11, 1 << 11)
    for i in range(lo, hi):
        word = words[i]
        kind = word >> 28
        if kind == EVT2_TIME:
            high = _next_high(high, np.int64(word & 0xFFFFFFF), 28, 6)
        column, row = np.int32(word >> 11 & 0x7FF), np.int32(word & 0x7FF)
        event = (kind <= EVT2_ON) & (high >= 0)
        t[kept] = high + np.int64(word >> 22 & 0x3F)
        x[kept] = column
        y[kept] = row
        p[kept] = kind
        if event and (column >= right or row >= bottom) and bad < 0:
            bad = i
        kept += np.uint64(event)
    return np.int64(kept), bad


@njit(cache=True, nogil=True)
def evt3_states(words, block):
    """Walk the words once. O(N). As `evt2_states`, and the number of events of every block.

    A state (int64 [M, 5]) is: high part of the time in µs (wraps at 2^24 µs added), low part, y,
    base x, polarity.
    """
    count = (words.size + block - 1) // block
    states, times = np.empty((count, 5), np.int64), np.empty(count, np.int64)
    events = np.zeros(count, np.int64)
    state = np.array([NO_TIME, 0, 0, 0, 0])
    last = first = np.int64(NO_TIME)
    falls = 0
    for i in range(words.size):
        if i % block == 0:
            states[i // block] = state
            times[i // block] = last
        kind = words[i] >> 12
        found = _events_of(words[i], kind) if state[0] >= 0 else 0
        if found:
            events[i // block] += found
            time = state[0] + state[1]
            falls += time < last
            last = time
            if first < 0:
                first = time
        _advance(state, words[i], kind)
    return states, times, events, falls == 0, (max(first, 0), max(last, 0))


@njit(cache=True, nogil=True, inline="always")
def _events_of(word, kind):
    """Number of events that a word stands for."""
    if kind == EVT3_X:
        return 1
    if kind in (EVT3_VECTOR_12, EVT3_VECTOR_8):
        bits = np.int64(word & (0xFFF if kind == EVT3_VECTOR_12 else 0xFF))
        count = 0
        while bits:
            bits &= bits - 1
            count += 1
        return count
    return 0


@njit(cache=True, nogil=True, inline="always")
def _advance(state, word, kind):
    """Change the state by a word."""
    if kind == EVT3_HIGH:
        high = _next_high(state[0], np.int64(word & 0xFFF), 12, 12)
        if high != state[0]:
            # the low part that is in force belongs to the tick before
            state[0], state[1] = high, 0
    elif kind == EVT3_LOW:
        state[1] = word & 0xFFF
    elif kind == EVT3_Y:
        state[2] = word & 0x7FF
    elif kind == EVT3_BASE:
        state[3], state[4] = word & 0x7FF, word >> 11 & 1
    elif kind == EVT3_VECTOR_12:
        state[3] += 12
    elif kind == EVT3_VECTOR_8:
        state[3] += 8


@njit(cache=True, nogil=True)
def evt3_decode(words, lo, hi, before, width, height, t, x, y, p):
    """Decode words lo..hi, the state `before` being in force at `lo`. O(hi - lo + events)."""
    state = before.copy()
    bad = -1
    kept = 0
    right, bottom = (width, height) if width > 0 else (1 << 15, 1 << 11)
    for i in range(lo, hi):
        word = words[i]
        kind = word >> 12
        if state[0] >= 0 and kind in (EVT3_X, EVT3_VECTOR_12, EVT3_VECTOR_8):
            single = kind == EVT3_X
            column = np.int64(word & 0x7FF) if single else state[3]
            bits = 1 if single else np.int64(word & (0xFFF if kind == EVT3_VECTOR_12 else 0xFF))
            polarity = np.int64(word >> 11 & 1) if single else state[4]
            while bits:
                if bits & 1:
                    if (column >= right or state[2] >= bottom) and bad < 0:
                        bad = i
                    t[kept] = state[0] + state[1]
                    x[kept] = column
                    y[kept] = state[2]
                    p[kept] = polarity
                    kept += 1
                bits >>= 1
                column += 1
        _advance(state, word, kind)
    return kept, bad
