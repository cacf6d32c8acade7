"""Prophesee EVT 2.1 words, 64 bits each, to event columns and back; see `kernels.evt`.

The lower half of a word is that of EVT2; the upper half says which of the 32 pixels from x on have that event. (Where
cameras write the halves the other way round, they are exchanged before.) `state` is int64 [1].
"""

from __future__ import annotations

import numpy as np

from nvsdata.kernels.compiling import njit
from nvsdata.kernels.evt import FALLS, FAR, FIRST, LAST, WORDS, count_shown, ones, shown_next
from nvsdata.kernels.evt2 import EVT2_ON, EVT2_TIME, evt2_tick

GROUP = 32  # pixels


@njit
def evt21_walk(raw, block, state, seen, states, times):
    """Walk over a piece of the words. O(N). Like `evt2_walk`."""
    words = raw.view(np.uint32).reshape(-1, 2)
    begin, last, first = seen[WORDS], seen[LAST], seen[FIRST]
    high = state[0]
    falls = 0
    for start in range(0, len(words), block):
        k = (begin + start) // block
        states[k, 0], times[k] = high, last
        for i in range(start, min(start + block, len(words))):
            word, mask = words[i]
            kind = word >> 28
            if kind == EVT2_TIME:
                high = evt2_tick(seen, high, word, i)
            elif kind <= EVT2_ON and high >= 0 and mask:
                time = high + np.int64(word >> 22 & 0x3F)
                falls += time < last
                last = time
                first = time if first < 0 else first
    state[0] = high
    seen[LAST], seen[FIRST], seen[WORDS] = last, first, begin + len(words)
    seen[FALLS] += falls


@njit
def evt21_count(raw):
    """Number of events in a piece of the words, those before any time included. O(N)."""
    count = 0
    for word, mask in raw.view(np.uint32).reshape(-1, 2):
        count += ones(np.int64(mask)) if word >> 28 <= EVT2_ON else 0
    return count


@njit
def evt21_decode(raw, width, height, state, seen, kept, t, x, y, p):
    """Decode a piece of the words. O(N + events)."""
    words = raw.view(np.uint32).reshape(-1, 2)
    bad, begin = np.int64(-1), kept
    right, bottom = (width, height) if width > 0 else (FAR, 1 << 11)
    high = state[0]
    for i in range(len(words)):
        word, mask = words[i]
        kind = word >> 28
        if kind == EVT2_TIME:
            high = evt2_tick(seen, high, word, i)
        elif kind <= EVT2_ON and high >= 0:
            time, row = high + np.int64(word >> 22 & 0x3F), np.int64(word & 0x7FF)
            column = np.int64(word >> 11 & 0x7FF)
            while mask:
                if mask & 1:
                    if (column >= right or row >= bottom) and bad < 0:
                        bad = i
                    t[kept], x[kept], y[kept], p[kept] = time, min(column, FAR), row, kind
                    kept += 1
                mask >>= 1
                column += 1
    state[0] = high
    seen[WORDS] += len(words)
    return kept - begin, bad


@njit
def evt21_encode(t, x, y, p, state):
    """Words of sorted events, uint32 [M, 2]. O(N). `state` as in `evt2_encode`."""
    high = state[0]
    words = np.empty((t.size + count_shown(t, high, 28, 6), 2), np.uint32)
    kept = i = 0
    while i < t.size:
        while high != t[i] >> 6:
            high = shown_next(high, t[i] >> 6, 28)
            words[kept, 0], words[kept, 1] = EVT2_TIME << 28 | high & 0xFFFFFFF, 0
            kept += 1
        base = np.int64(x[i]) // GROUP * GROUP
        words[kept, 0] = np.int64(p[i]) << 28 | (t[i] & 0x3F) << 22 | base << 11 | np.int64(y[i])
        mask = np.int64(1) << (np.int64(x[i]) - base)
        i += 1
        # neighbors follow in their order, so that reading gives it back
        while (
            i < t.size and t[i] == t[i - 1] and y[i] == y[i - 1] and p[i] == p[i - 1] and x[i - 1] < x[i] < base + GROUP
        ):
            mask |= np.int64(1) << (np.int64(x[i]) - base)
            i += 1
        words[kept, 1] = mask
        kept += 1
    state[0] = high
    return words[:kept]
