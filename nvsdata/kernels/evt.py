"""What Prophesee's EVT encodings share: words with the high bits of the time, and what is noted while words pass.

The high bits of the time come in words of their own, so a walk over all words finds the state before each block of
words; a window then decodes only its blocks, and the whole is decoded without a walk. See `kernels.decode` for what a
decoder takes and returns, and `kernels.clock` for the times; where a word holds several events, the columns have room
for those that are counted before, and for one more.

`state` begins with the high part of the time in µs (wraps added). What a walk has seen is int64 [5], indexed by the
names below; a decoder notes WORDS and JUMP. Encoders write the high part at the end and at the beginning of each wrap,
and at least once in each half of one, so that any reader counts the wraps alike.
"""

from __future__ import annotations

import numpy as np

from nvsdata.kernels.clock import BACK_US, SILENT_US, first_time, is_jump, nearest
from nvsdata.kernels.compiling import njit

IGNORED = 0xF  # a type of word that all decoders skip
NO_TIME = -1  # before the first word with high bits: events there have no time
# Times of the last and the first event, number of times that fell, number of words, first word that no camera wrote
LAST, FIRST, FALLS, WORDS, JUMP = range(5)
UNSEEN = (-1, -1, 0, 0, -1)
FAR = 32_767  # pixels; events have x and y below it


@njit(inline="always")
def next_high(before, raw, bits, shift):
    """The high part that `raw` (of `bits` bits) stands for, in µs."""
    if before >= 0:
        return nearest(raw, before >> shift, bits) << shift
    return first_time(raw, bits) << shift


@njit(inline="always")
def _is_jump(before, high, bits):
    """Whether no camera continues at `high` µs or, for a counter's first word, begins there."""
    return high < 0 if before < 0 else is_jump(before, high, bits, BACK_US, SILENT_US)


@njit(inline="always")
def note_jump(seen, before, high, bits, i):
    """Note word i of a piece, if it's the first that no camera wrote; `seen` counts the words before the piece."""
    if seen[JUMP] < 0 and _is_jump(before, high, bits):
        seen[JUMP] = seen[WORDS] + np.int64(i)


@njit(inline="always")
def ones(bits):
    """Number of ones of at most 32 bits."""
    pairs = bits - (bits >> 1 & 0x55555555)
    fours = (pairs & 0x33333333) + (pairs >> 2 & 0x33333333)
    eights = fours + (fours >> 4) & 0x0F0F0F0F
    return (eights * 0x01010101 & 0xFFFFFFFF) >> 24


@njit(inline="always")
def shown_next(before, high, bits):
    """The high part to write after `before` on the way to `high`, both without wraps taken off; -1 before the first."""
    half = np.int64(1) << (bits - 1)
    end = before | (2 * half - 1)
    return end + 1 if before == end else min(before + half - 1, end, high)


@njit
def count_shown(t, before, bits, shift):
    """Number of words with high parts that events at sorted times `t` (µs) need after the part `before`. O(N)."""
    count = 0
    for i in range(t.size):
        while before != t[i] >> shift:
            before = shown_next(before, t[i] >> shift, bits)
            count += 1
    return count
