"""Prophesee EVT3 words, 16 bits each, to event columns and back; see `kernels.evt`.

Bits 12 to 15 are a word's type. Row, column, and high and low 12 bits of the time come in words of their own; after a
word with a base, each vector has a bit for each of the next 12 or 8 columns. `state` is int64 [5]: the high part of the
time in µs, the low part, y, base x and polarity.
"""

from __future__ import annotations

import numpy as np

from nvsdata.kernels.compiling import njit
from nvsdata.kernels.evt import FALLS, FAR, FIRST, LAST, WORDS, count_shown, next_high, note_jump, ones, shown_next

EVT3_Y, EVT3_X, EVT3_BASE, EVT3_VECTOR_12, EVT3_VECTOR_8, EVT3_LOW, EVT3_HIGH = 0x0, 0x2, 0x3, 0x4, 0x5, 0x6, 0x8
EVT3_TRIGGER = 0xA
# kinds that are rare or come in groups
SPECIAL = 1 << EVT3_BASE | 1 << EVT3_VECTOR_12 | 1 << EVT3_VECTOR_8 | 1 << EVT3_HIGH


@njit
def evt3_walk(raw, block, state, seen, states, times):
    """Walk over a piece of the words. O(N). Like `evt2_walk` (states int64 [M, 5])."""
    words = raw.view(np.uint16)
    begin, last, first = seen[WORDS], seen[LAST], seen[FIRST]
    high, low, row, base, polarity = state
    falls = 0
    for start in range(0, words.size, block):
        k = (begin + start) // block
        states[k] = high, low, row, base, polarity
        times[k] = last
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
                    note_jump(seen, before, high, 24, i)
                elif kind == EVT3_BASE:
                    base, polarity = word & 0x7FF, word >> 11 & 1
                else:
                    size = 12 if kind == EVT3_VECTOR_12 else 8
                    found = ones(word & ((1 << size) - 1))
                    base += size
            found = found if high >= 0 else 0
            time = high + low if found else last
            falls += time < last
            last = time
            first = time if found and first < 0 else first
    state[0], state[1], state[2], state[3], state[4] = high, low, row, base, polarity
    seen[LAST], seen[FIRST], seen[WORDS] = last, first, begin + words.size
    seen[FALLS] += falls


@njit
def evt3_highs(raw):
    """Which words of a piece hold the high part of the time, and that part."""
    words = raw.view(np.uint16)
    found = np.flatnonzero(words >> 12 == EVT3_HIGH)
    return found, (words[found] & 0xFFF).astype(np.int64)


@njit
def evt3_count(raw):
    """Number of events in a piece of the words, those before any time included. O(N)."""
    words = raw.view(np.uint16)
    count = 0
    for i in range(np.uint64(words.size)):
        word = np.int64(words[i])
        kind = word >> 12
        bits = word & 0xFFF if kind == EVT3_VECTOR_12 else word & 0xFF if kind == EVT3_VECTOR_8 else 0
        count += np.int64(kind == EVT3_X) + ones(bits)
    return count


@njit
def evt3_decode(raw, width, height, state, seen, kept, t, x, y, p):
    """Decode a piece of the words. O(N + events). There must be room for one more event."""
    words = raw.view(np.uint16)
    bad = np.int64(-1)
    begin, kept = np.uint64(kept), np.uint64(kept)
    one = np.uint64(1)
    right, bottom = (width, height) if width > 0 else (FAR, 1 << 11)
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
                note_jump(seen, before, high, 24, i)
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
                        t[kept], x[kept], y[kept], p[kept] = high + low, min(column, FAR), row, polarity
                        kept += one
                    bits >>= 1
                    column += 1
                base += size
    state[0], state[1], state[2], state[3], state[4] = high, low, row, base, polarity
    seen[WORDS] += words.size
    return np.int64(kept - begin), bad


@njit(inline="always")
def _tick(high, low, word):
    """High and low part of the time after a word with the high part."""
    now = next_high(high, word & 0xFFF, 12, 12)
    # the low part that is in force belongs to the tick before
    return now, low if now == high else np.int64(0)


@njit
def evt3_triggers(raw, state):
    """Times in µs, channels and levels of the external triggers in a piece of the words; updates `state`."""
    words = raw.view(np.uint16)
    high, low = state[0], state[1]
    room = np.count_nonzero(words >> 12 == EVT3_TRIGGER)
    t, channel, level = np.empty(room, np.int64), np.empty(room, np.uint8), np.empty(room, np.uint8)
    kept = 0
    for short in words:
        word = np.int64(short)
        kind = word >> 12
        if kind == EVT3_HIGH:
            high, low = _tick(high, low, word)
        elif kind == EVT3_LOW:
            low = word & 0xFFF
        elif kind == EVT3_TRIGGER and high >= 0:
            t[kept], channel[kept], level[kept] = high + low, word >> 8 & 0xF, word & 1
            kept += 1
    state[0], state[1] = high, low
    return t[:kept], channel[:kept], level[:kept]


@njit
def evt3_encode(t, x, y, p, state):
    """Words of sorted events, uint16. O(N).

    `state` int64 [3]: the high and low part of the time and the row that were written last, -1 before any.
    """
    high, low, row = state
    words = np.empty(3 * t.size + count_shown(t, high, 12, 12), np.uint16)
    kept = i = 0
    while i < t.size:
        while high != t[i] >> 12:
            high, low = shown_next(high, t[i] >> 12, 12), np.int64(-1)
            words[kept] = EVT3_HIGH << 12 | high & 0xFFF
            kept += 1
        if low != t[i] & 0xFFF:
            low = t[i] & 0xFFF
            words[kept] = EVT3_LOW << 12 | low
            kept += 1
        if row != y[i]:
            row = np.int64(y[i])
            words[kept] = EVT3_Y << 12 | row
            kept += 1
        stop = i + 1
        while stop < t.size and t[stop] == t[i] and y[stop] == y[i] and p[stop] == p[i] and x[stop] > x[stop - 1]:
            stop += 1
        if stop - i < 3:
            for j in range(i, stop):
                words[kept] = EVT3_X << 12 | np.int64(p[i]) << 11 | np.int64(x[j])
                kept += 1
        else:
            kept = _write_row(words, kept, x[i:stop], np.int64(p[i]) << 11)
        i = stop
    state[0], state[1], state[2] = high, low, row
    return words[:kept]


@njit
def _write_row(words, kept, x, polarity):
    """Write events of one row and time at rising `x`, as vectors where these are shorter; returns the next place."""
    i = 0
    while i < x.size:
        # a base and a vector instead of three events
        if i + 2 >= x.size or x[i + 2] >= x[i] + 12:
            words[kept] = EVT3_X << 12 | polarity | np.int64(x[i])
            kept += 1
            i += 1
            continue
        base = np.int64(x[i])
        words[kept] = EVT3_BASE << 12 | polarity | base
        kept += 1
        # 12, 12 and 8 pixels, as cameras do: some decoders rely on it
        for part in range(3):
            size = 8 if part == 2 else 12
            if i == x.size or x[i] >= base + size:
                break
            bits = np.int64(0)
            while i < x.size and x[i] < base + size:
                bits |= np.int64(1) << (np.int64(x[i]) - base)
                i += 1
            words[kept] = (EVT3_VECTOR_8 if part == 2 else EVT3_VECTOR_12) << 12 | bits
            kept += 1
            base += size
    return kept
