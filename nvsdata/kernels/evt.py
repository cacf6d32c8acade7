"""Prophesee EVT2 and EVT3 words to event columns.

Both formats send the high bits of the time in separate words, so a walk over all words finds
the state before each block of words; a window then decodes only its blocks. See `kernels.decode` for what a
decoder takes and returns, and `kernels.clock` for the times; EVT3's columns have room for the events that its walk
counts.

`state` is int64 [1] or [5]: the high part of the time in µs (wraps added), and for EVT3 the low part, y, base x and
polarity. What a walk has seen is int64 [5], indexed by the names below.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from nvsdata.kernels.clock import BACK_US, SILENT_US, first_time, is_jump, nearest

EVT2_OFF, EVT2_ON, EVT2_TIME = 0x0, 0x1, 0x8
EVT3_Y, EVT3_X, EVT3_BASE, EVT3_VECTOR_12, EVT3_VECTOR_8, EVT3_LOW, EVT3_HIGH = 0x0, 0x2, 0x3, 0x4, 0x5, 0x6, 0x8
IGNORED = 0xF  # a type of word that both decoders skip
NO_TIME = -1  # before the first word with high bits: events there have no time
# Times of the last and the first event, number of times that fell, number of words, first word that no camera wrote
LAST, FIRST, FALLS, WORDS, JUMP = range(5)
UNSEEN = (-1, -1, 0, 0, -1)
UNDATED = (NO_TIME, 0, 0, 0, 0)


@njit(cache=True, nogil=True)
def evt2_walk(raw, block, state, seen, states, times):
    """Walk over a piece of the words. O(N). Writes for every `block`-th word of the file

    - the state in force there (int64 [M, 1]),
    - the time of the last event before it (int64 [M], -1 if there is none).
    """
    words = raw.view(np.uint32)
    begin, last, first = seen[WORDS], seen[LAST], seen[FIRST]
    high = state[0]
    falls = 0
    for i in range(words.size):
        if (begin + i) % block == 0:
            states[(begin + i) // block, 0], times[(begin + i) // block] = high, last
        kind = words[i] >> 28
        if kind == EVT2_TIME:
            before = high
            high = _next_high(high, np.int64(words[i] & 0xFFFFFFF), 28, 6)
            if seen[JUMP] < 0 and _is_jump(before, high, 34):
                seen[JUMP] = begin + i
        elif kind <= EVT2_ON and high >= 0:
            time = high + np.int64(words[i] >> 22 & 0x3F)
            falls += time < last
            last = time
            if first < 0:
                first = time
    state[0] = high
    seen[LAST], seen[FIRST], seen[WORDS] = last, first, begin + words.size
    seen[FALLS] += falls


@njit(cache=True, nogil=True, inline="always")
def _next_high(before, raw, bits, shift):
    """The high part that `raw` (of `bits` bits) stands for, in µs."""
    if before >= 0:
        return nearest(raw, before >> shift, bits) << shift
    return first_time(raw, bits) << shift


@njit(cache=True, nogil=True, inline="always")
def _is_jump(before, high, bits):
    """Whether no camera continues at `high` µs or, for a counter's first word, begins there."""
    return high < 0 if before < 0 else is_jump(before, high, bits, BACK_US, SILENT_US)


@njit(cache=True, nogil=True)
def evt2_highs(raw):
    """Which words of a piece hold the high part of the time, and that part."""
    words = raw.view(np.uint32)
    found = np.flatnonzero(words >> 28 == EVT2_TIME)
    return found, (words[found] & 0xFFFFFFF).astype(np.int64)


@njit(cache=True, nogil=True)
def evt3_highs(raw):
    """Which words of a piece hold the high part of the time, and that part."""
    words = raw.view(np.uint16)
    found = np.flatnonzero(words >> 12 == EVT3_HIGH)
    return found, (words[found] & 0xFFF).astype(np.int64)


@njit(cache=True, nogil=True)
def evt2_decode(raw, width, height, state, kept, t, x, y, p):
    """Decode a piece of the words. O(N)."""
    words = raw.view(np.uint32)
    bad = -1
    begin = np.uint64(kept)
    kept = np.uint64(kept)
    high = state[0]
    right, bottom = (width, height) if width > 0 else (1 << 11, 1 << 11)
    for i in range(words.size):
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
    state[0] = high
    return np.int64(kept - begin), bad


@njit(cache=True, nogil=True)
def evt3_walk(raw, block, state, seen, states, times, events):
    """Walk over a piece of the words. O(N). Like `evt2_walk` (states int64 [M, 5]); also counts each block's events."""
    words = raw.view(np.uint16)
    begin = seen[WORDS]
    for i in range(words.size):
        k = (begin + i) // block
        if (begin + i) % block == 0:
            states[k] = state
            times[k] = seen[LAST]
        kind = words[i] >> 12
        found = _events_of(words[i], kind) if state[0] >= 0 else 0
        if found:
            events[k] += found
            time = state[0] + state[1]
            seen[FALLS] += time < seen[LAST]
            seen[LAST] = time
            if seen[FIRST] < 0:
                seen[FIRST] = time
        before = state[0]
        _advance(state, words[i], kind)
        if kind == EVT3_HIGH and seen[JUMP] < 0 and _is_jump(before, state[0], 24):
            seen[JUMP] = begin + i
    seen[WORDS] = begin + words.size


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
    """Update the state by a word."""
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
def evt3_decode(raw, width, height, state, kept, t, x, y, p):
    """Decode a piece of the words. O(N + events)."""
    words = raw.view(np.uint16)
    bad = -1
    begin = kept
    right, bottom = (width, height) if width > 0 else (1 << 15, 1 << 11)
    for i in range(words.size):
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
    return kept - begin, bad
