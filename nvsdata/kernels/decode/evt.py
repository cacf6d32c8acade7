"""Shared parts of Prophesee's EVT encodings: words with the high bits of the time, and the state between words.

The high bits of the time come in words of their own, so a walk over all words finds the state before each block of
words; a window then decodes only its blocks, and the whole is decoded without a walk. See `columns.h` for what a
decoder takes and returns, and `kernels.decode.clock` for the times; where a word holds several events, the columns have
room for those that are counted before, and for one more.

`state` begins with the high part of the time in µs (wraps added). What a walk has seen is int64 [5], indexed by the
names below; a decoder notes WORDS and JUMP. Encoders write the high part at the end and at the beginning of each wrap,
and at least once in each half of one, so that any reader counts the wraps alike.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from nvsdata.kernels import _native

TIME = 0x8  # a type of word
IGNORED = 0xF  # a type of word that all decoders skip
NO_TIME = -1  # before the first word with high bits: events there have no time
# Times of the last and the first event, number of times that fell, number of words, first word that no camera wrote
LAST, FIRST, FALLS, WORDS, JUMP = range(5)
UNSEEN = (-1, -1, 0, 0, -1)


def count_shown(t: np.ndarray, before: int, bits: int, shift: int) -> int:
    """Return the number of words with high parts that events at sorted times `t` (µs) need after the part `before`."""
    count: int = _native.count_shown(t, before, bits, shift)
    return count


def find_triggers(
    kernel: Callable[..., int], count: Callable[..., int], raw: np.ndarray, state: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return times in µs, channels and levels of the external triggers in a piece of the words."""
    room = count(raw)
    t, channel, level = np.empty(room, np.int64), np.empty(room, np.uint8), np.empty(room, np.uint8)
    kept = kernel(raw, state, t, channel, level)
    return t[:kept], channel[:kept], level[:kept]
