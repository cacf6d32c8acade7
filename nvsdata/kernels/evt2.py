"""Prophesee EVT2 words, 32 bits each, to event columns and back; see `kernels.evt`.

Bits 28 to 31 are a word's type. An event has the low 6 bits of its time in bits 22 to 27, x in 11 to 21, y in 0 to 10;
a word of time has the high 28 bits. `state` is int64 [1].
"""

from __future__ import annotations

import numpy as np

from nvsdata.kernels.compiling import njit
from nvsdata.kernels.evt import FALLS, FIRST, LAST, WORDS, count_shown, next_high, note_jump, shown_next

EVT2_OFF, EVT2_ON, EVT2_TIME, EVT2_TRIGGER = 0x0, 0x1, 0x8, 0xA


@njit(inline="always")
def evt2_tick(seen, high, word, i):
    """The high part of the time after `word`, word i of a piece, which has it; a jump is noted."""
    now = next_high(high, np.int64(word & 0xFFFFFFF), 28, 6)
    note_jump(seen, high, now, 34, i)
    return now


@njit
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
                high = evt2_tick(seen, high, word, i)
    state[0] = high
    seen[LAST], seen[FIRST], seen[WORDS] = last, first, begin + words.size
    seen[FALLS] += falls


@njit
def evt2_highs(words):
    """Which words of a piece, uint32 [N], hold the high part of the time, and that part."""
    found = np.flatnonzero(words >> 28 == EVT2_TIME)
    return found, (words[found] & 0xFFFFFFF).astype(np.int64)


@njit
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
            high = evt2_tick(seen, high, word, i)
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


@njit
def evt2_triggers(words, state):
    """Times in µs, channels and levels of the external triggers in a piece of words, uint32 [N]; updates `state`."""
    high = state[0]
    room = np.count_nonzero(words >> 28 == EVT2_TRIGGER)
    t, channel, level = np.empty(room, np.int64), np.empty(room, np.uint8), np.empty(room, np.uint8)
    kept = 0
    for word in words:
        kind = word >> 28
        if kind == EVT2_TIME:
            high = next_high(high, np.int64(word & 0xFFFFFFF), 28, 6)
        elif kind == EVT2_TRIGGER and high >= 0:
            t[kept], channel[kept], level[kept] = high + np.int64(word >> 22 & 0x3F), word >> 8 & 0x1F, word & 1
            kept += 1
    state[0] = high
    return t[:kept], channel[:kept], level[:kept]


@njit
def evt2_encode(t, x, y, p, state):
    """Words of sorted events, uint32. O(N). `state` int64 [1]: the high part that was written last, -1 before any."""
    high = state[0]
    words = np.empty(t.size + count_shown(t, high, 28, 6), np.uint32)
    kept = 0
    for i in range(t.size):
        while high != t[i] >> 6:
            high = shown_next(high, t[i] >> 6, 28)
            words[kept] = EVT2_TIME << 28 | high & 0xFFFFFFF
            kept += 1
        words[kept] = np.int64(p[i]) << 28 | (t[i] & 0x3F) << 22 | np.int64(x[i]) << 11 | np.int64(y[i])
        kept += 1
    state[0] = high
    return words
