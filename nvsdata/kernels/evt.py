"""Prophesee EVT2 and EVT3 words to event columns.

Both formats send the high bits of the time in separate words, so a walk over all words finds the state before each
block of words; a window then decodes only its blocks, and the whole is decoded without a walk. See `kernels.decode` for
what a decoder takes and returns, and `kernels.clock` for the times; EVT3's columns have room for the events that are
counted before.

`state` is int64 [1] or [5]: the high part of the time in µs (wraps added), and for EVT3 the low part, y, base x and
polarity. What a walk has seen is int64 [5], indexed by the names below; a decoder notes WORDS and JUMP.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from nvsdata.kernels.clock import BACK_US, SILENT_US, first_time, is_jump, nearest

EVT2_OFF, EVT2_ON, EVT2_TIME = 0x0, 0x1, 0x8
EVT3_Y, EVT3_X, EVT3_BASE, EVT3_VECTOR_12, EVT3_VECTOR_8, EVT3_LOW, EVT3_HIGH = 0x0, 0x2, 0x3, 0x4, 0x5, 0x6, 0x8
# kinds that are rare or come in groups
SPECIAL = 1 << EVT3_BASE | 1 << EVT3_VECTOR_12 | 1 << EVT3_VECTOR_8 | 1 << EVT3_HIGH
IGNORED = 0xF  # a type of word that both decoders skip
NO_TIME = -1  # before the first word with high bits: events there have no time
# Times of the last and the first event, number of times that fell, number of words, first word that no camera wrote
LAST, FIRST, FALLS, WORDS, JUMP = range(5)
UNSEEN = (-1, -1, 0, 0, -1)
UNDATED = (NO_TIME, 0, 0, 0, 0)


@njit(cache=True, nogil=True)
def evt2_walk(raw, block, state, seen, states, times):
    """Walk over a piece of the words, which begins with a block. O(N). Writes for every `block`-th word of the file

    - the state in force there (int64 [M, 1]),
    - the time of the last event before it (int64 [M], -1 if there is none).
    """
    words = raw.view(np.uint32)
    begin, last, first = seen[WORDS], seen[LAST], seen[FIRST]
    high = state[0]
    falls = 0
    for start in range(0, words.size, block):
        states[(begin + start) // block, 0], times[(begin + start) // block] = high, last
        for i in range(np.uint64(start), np.uint64(min(start + block, words.size))):
            word = words[i]
            kind = word >> 28
            if kind <= EVT2_ON and high >= 0:
                time = high + np.int64(word >> 22 & 0x3F)
                falls += time < last
                last = time
                first = time if first < 0 else first
            elif kind == EVT2_TIME:
                before = high
                high = _next_high(high, np.int64(word & 0xFFFFFFF), 28, 6)
                _note_jump(seen, before, high, 34, i)
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


@njit(cache=True, nogil=True, inline="always")
def _note_jump(seen, before, high, bits, i):
    """Note word i of a piece, if it's the first that no camera wrote; `seen` counts the words before the piece."""
    if seen[JUMP] < 0 and _is_jump(before, high, bits):
        seen[JUMP] = seen[WORDS] + np.int64(i)


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
def evt2_decode(raw, width, height, state, seen, kept, t, x, y, p):
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
            before = high
            high = _next_high(high, np.int64(word & 0xFFFFFFF), 28, 6)
            _note_jump(seen, before, high, 34, i)
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
    seen[WORDS] += words.size
    return np.int64(kept - begin), bad


@njit(cache=True, nogil=True)
def evt3_walk(raw, block, state, seen, states, times, events):
    """Walk over a piece of the words. O(N). Like `evt2_walk` (states int64 [M, 5]); also counts each block's events."""
    words = raw.view(np.uint16)
    begin, last, first = seen[WORDS], seen[LAST], seen[FIRST]
    high, low, row, base, polarity = state
    falls = 0
    for start in range(0, words.size, block):
        k = (begin + start) // block
        states[k] = high, low, row, base, polarity
        times[k] = last
        count = 0
        for i in range(np.uint64(start), np.uint64(min(start + block, words.size))):
            word = np.int64(words[i])
            kind = word >> 12
            # without branches for what comes in any order
            row = word & 0x7FF if kind == EVT3_Y else row
            low = word & 0xFFF if kind == EVT3_LOW else low
            found = np.int64(kind == EVT3_X)
            if SPECIAL >> kind & 1:
                if kind == EVT3_HIGH:
                    before = high
                    high, low = _tick(high, low, word)
                    _note_jump(seen, before, high, 24, i)
                elif kind == EVT3_BASE:
                    base, polarity = word & 0x7FF, word >> 11 & 1
                else:
                    size = 12 if kind == EVT3_VECTOR_12 else 8
                    found = _ones(word & ((1 << size) - 1))
                    base += size
            found = found if high >= 0 else 0
            count += found
            time = high + low if found else last
            falls += time < last
            last = time
            first = time if found and first < 0 else first
        events[k] += count
    state[0], state[1], state[2], state[3], state[4] = high, low, row, base, polarity
    seen[LAST], seen[FIRST], seen[WORDS] = last, first, begin + words.size
    seen[FALLS] += falls


@njit(cache=True, nogil=True)
def evt3_count(raw):
    """Number of events in a piece of the words, those before any time included. O(N)."""
    words = raw.view(np.uint16)
    count = 0
    for i in range(np.uint64(words.size)):
        word = np.int64(words[i])
        kind = word >> 12
        bits = word & 0xFFF if kind == EVT3_VECTOR_12 else word & 0xFF if kind == EVT3_VECTOR_8 else 0
        count += np.int64(kind == EVT3_X) + _ones(bits)
    return count


@njit(cache=True, nogil=True, inline="always")
def _tick(high, low, word):
    """High and low part of the time after a word with the high part."""
    now = _next_high(high, word & 0xFFF, 12, 12)
    # the low part that is in force belongs to the tick before
    return now, low if now == high else np.int64(0)


@njit(cache=True, nogil=True, inline="always")
def _ones(bits):
    """Number of ones of at most 12 bits."""
    pairs = bits - (bits >> 1 & 0x555)
    fours = (pairs & 0x333) + (pairs >> 2 & 0x333)
    return (fours & 0xF) + (fours >> 4 & 0xF) + (fours >> 8 & 0xF)


@njit(cache=True, nogil=True)
def evt3_decode(raw, width, height, state, seen, kept, t, x, y, p):
    """Decode a piece of the words. O(N + events). There must be room for one more event."""
    words = raw.view(np.uint16)
    bad = np.int64(-1)
    begin, kept = np.uint64(kept), np.uint64(kept)
    one = np.uint64(1)
    right, bottom = (width, height) if width > 0 else (1 << 15, 1 << 11)
    high, low, row, base, polarity = state
    for i in range(np.uint64(words.size)):
        word = np.int64(words[i])
        kind = word >> 12
        # without branches for what comes in any order: a word that is no event is written over
        row = word & 0x7FF if kind == EVT3_Y else row
        low = word & 0xFFF if kind == EVT3_LOW else low
        column = word & 0x7FF
        t[kept], x[kept], y[kept], p[kept] = high + low, column, row, word >> 11 & 1
        event = (kind == EVT3_X) & (high >= 0)
        if event & ((column >= right) | (row >= bottom)) and bad < 0:
            bad = np.int64(i)
        kept += np.uint64(event)
        if SPECIAL >> kind & 1:
            if kind == EVT3_HIGH:
                before = high
                high, low = _tick(high, low, word)
                _note_jump(seen, before, high, 24, i)
            elif kind == EVT3_BASE:
                base, polarity = word & 0x7FF, word >> 11 & 1
            else:
                size = 12 if kind == EVT3_VECTOR_12 else 8
                bits = word & ((1 << size) - 1) if high >= 0 else 0
                column = base
                while bits:
                    if bits & 1:
                        if (column >= right or row >= bottom) and bad < 0:
                            bad = np.int64(i)
                        t[kept], x[kept], y[kept], p[kept] = high + low, column, row, polarity
                        kept += one
                    bits >>= 1
                    column += 1
                base += size
    state[0], state[1], state[2], state[3], state[4] = high, low, row, base, polarity
    seen[WORDS] += words.size
    return np.int64(kept - begin), bad
