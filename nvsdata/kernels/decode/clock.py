"""Times of counters that wrap, and times among them that no camera wrote.

A counter of few bits gives a time only up to whole wraps. The time of a record is taken to be the one nearest to that
of the record before it, at most half a wrap earlier or later: so a damaged word moves no other event. Cameras write
events nearly in order, and noise all the time. So a step back of more than `BACK_US`, or to before time 0, is damage,
and so is a step across a wrap that lasts longer than `SILENT_US`.
"""

from __future__ import annotations

import numpy as np

from nvsdata.kernels import _native

BACK_US: int = _native.BACK_US
# No camera is silent for longer, because of its noise: a longer silence across a wrap comes from a damaged word. Within
# a wrap, where it moves no other event, a silence of any length is accepted
SILENT_US: int = _native.SILENT_US
LATEST: int = _native.LATEST  # µs; times lie between this and its negative, so that differences can't overflow
WRAP_US: int = _native.WRAP_US  # wrap of a 32-bit counter of µs
UNKNOWN: int = _native.UNKNOWN  # the time before a counter's first word
NONE = -1

# The state after some records: the time of the last one, and of the last one that began a block; 1 if that block
# began with many events; 1 if times fell; the number of the next record, of the first that no camera wrote, and of
# the first after a block that lasted longer than the index can see; 1 if records other than events were seen
LAST, BEGUN, DENSE, FELL, NEXT, JUMP, HIDDEN, MIXED = range(8)
# An index finds how long a block lasts, up to whole wraps, from its first word and the next block's. It reads all words
# of blocks that seem to last longer than SOON_US, or no time, or whose first PEEK records last longer than PEEK_US
SOON_US: int = _native.SOON_US
PEEK: int = _native.PEEK
PEEK_US: int = _native.PEEK_US


def clock_at(time: int, record: int) -> np.ndarray:
    """Return the state before `record`, the first of a block, whose time up to whole wraps is `time` or UNKNOWN."""
    return np.array((time, time, 0, 0, record, NONE, NONE, 0), np.int64)


def nearest_time(raw: int, last: int, bits: int) -> int:
    """Return the time nearest to `last` that a counter of `bits` bits shows as `raw`."""
    time: int = _native.nearest(raw, last, _checked(bits))
    return time


def first_time(raw: int, bits: int) -> int:
    """Return the time of a file's first word: its value, or -1 for 28 or more ones, which are erased memory."""
    time: int = _native.first_time(raw, _checked(bits))
    return time


def is_jump(before: int, after: int, bits: int, back: int, silent: int) -> bool:
    """Return whether the step from time `before` to `after` is damage, because no camera makes it.

    Such steps go back by more than `back`, to a negative time, or forward by more than `silent` across a wrap.
    """
    jump: bool = _native.is_jump(before, after, _checked(bits), back, silent)
    return jump


def _checked(bits: int) -> int:
    if not 1 <= bits <= 61:
        raise ValueError(f"a counter of {bits} bits: it has 1 to 61")
    return bits


def unwrap(state: np.ndarray, t: np.ndarray, block: int) -> None:
    """Turn the words of a 32-bit counter, `t` int64 [N], into times in place, and advance the state. O(N).

    `block`: number of records in a block.
    """
    _native.unwrap(state, t, block)


def go_evenly(state: np.ndarray, t: np.ndarray, block: int) -> None:
    """Advance the state by records of times `t`, int64 [N], that never fall and span less than half a wrap."""
    _native.go_evenly(state, t, block)


def lasting(raw: np.ndarray) -> tuple[int, bool]:
    """Return the µs from the first to the last of a 32-bit counter's words, uint32 [N]; True if a word is damaged."""
    time: tuple[int, bool] = _native.lasting(raw)
    return time


def extremes(t: np.ndarray, block: int, starts: np.ndarray, lowest: np.ndarray, highest: np.ndarray) -> None:
    """Write the first, lowest and highest time of each block of `block` records in `t`, int64 [N]. O(N)."""
    _native.extremes(t, block, starts, lowest, highest)


def kept_words(raw: np.ndarray, bits: int, back: int, silent: int = LATEST) -> np.ndarray:
    """Return the mask of the largest set of words without a jump between them (see `is_jump`). O(N log N).

    `raw` int64 [N] shows a counter of `bits` bits; `back` and `silent` are in its units.
    """
    keep = np.empty(raw.size, np.bool_)
    _native.kept_words(raw, _checked(bits), back, silent, keep)
    return keep
