"""Shared parts of Prophesee's EVT encodings: words with the high bits of the time, and the state between words.

The high bits of the time are in separate words. A walk over all words finds the state before each block of words, so
that a window decodes only its blocks. To decode the entire file, no walk is needed. The arguments and results of a
decoder are described in `columns.h`, and times in `kernels.decode.clock`. If a word contains several events, the events
are counted first, and the columns have room for one more.

`state` begins with the high part of the time in µs (wraps added). A walk fills an int64 [5], indexed by the names
below; a decoder fills only WORDS and JUMP. Encoders write the high part at the end and at the beginning of each wrap,
and at least once in each half of a wrap, so that every reader counts the wraps correctly.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from nvsdata.kernels import _native

TIME = 0x8  # a type of word
IGNORED = 0xF  # a type of word that all decoders skip
NO_TIME = -1  # state before the first word with high bits, where events have no time
# Times of the last and the first event, numbers of decreases of time and of words, first word with an impossible time
LAST, FIRST, FALLS, WORDS, JUMP = range(5)
UNSEEN = (-1, -1, 0, 0, -1)


def count_shown(t: np.ndarray, before: int, bits: int, shift: int) -> int:
    """Return the number of words with high bits that events need, if the high part `before` was written last.

    `t` has the sorted times of the events in µs.
    """
    count: int = _native.count_shown(t, before, bits, shift)
    return count


def find_triggers(
    kernel: Callable[..., int], count: Callable[..., int], raw: np.ndarray, state: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the times in µs, channels and levels of the external triggers in a piece of the words `raw`."""
    room = count(raw)
    t, channel, level = np.empty(room, np.int64), np.empty(room, np.uint8), np.empty(room, np.uint8)
    kept = kernel(raw, state, t, channel, level)
    return t[:kept], channel[:kept], level[:kept]
