"""Times from counters that wrap, and detection of impossible times.

A counter with few bits determines a time only up to a multiple of its wrap. A record gets the possible time that is
nearest to the time of the record before it, at most half a wrap earlier or later, so a damaged word changes the time of
no other event. Cameras write events nearly in order of time, and noise causes events without long pauses. So a time is
damaged if it is negative, if it decreases by more than `BACK_US`, or if it increases by more than `SILENT_US` across a
wrap.
"""

from __future__ import annotations

import numpy as np

from nvsdata.kernels import _native

BACK_US: int = _native.BACK_US
# Because of noise, no camera sends nothing for longer: a longer pause across a wrap comes from a damaged word. Within a
# wrap, a pause of any length is accepted, because it changes the time of no other event
SILENT_US: int = _native.SILENT_US
LATEST: int = _native.LATEST  # µs; times are between this and its negative, so that differences can't overflow
WRAP_US: int = _native.WRAP_US  # wrap of a 32-bit counter of µs
UNKNOWN: int = _native.UNKNOWN  # the time before a counter's first word
NONE = -1

# The state after some records: time of the last record; time of the last record that began a block; 1 if that block
# began with many events; 1 if times decreased; numbers of the next record, of the first record with an impossible time,
# and of the first record after a block that is too long for the index; 1 if there were records other than events
LAST, BEGUN, DENSE, FELL, NEXT, JUMP, HIDDEN, MIXED = range(8)
# An index computes the duration of a block, up to a multiple of the wrap, from the first words of this block and the
# next. It reads all words of a block that seems to last longer than SOON_US, or 0 µs, or whose first PEEK records last
# longer than PEEK_US
SOON_US: int = _native.SOON_US
PEEK: int = _native.PEEK
PEEK_US: int = _native.PEEK_US


def clock_at(time: int, record: int) -> np.ndarray:
    """Return the state before `record`, the first one of a block.

    `time` is the time of this record in µs, up to a multiple of the wrap, or UNKNOWN.
    """
    return np.array((time, time, 0, 0, record, NONE, NONE, 0), np.int64)


def nearest_time(raw: int, last: int, bits: int) -> int:
    """Return the time nearest to the time `last` at which a counter of `bits` bits has the value `raw`."""
    time: int = _native.nearest(raw, last, _checked(bits))
    return time


def first_time(raw: int, bits: int) -> int:
    """Return the time of the first word of a file: its value, or -1 if it has 28 or more ones, as erased memory has."""
    time: int = _native.first_time(raw, _checked(bits))
    return time


def is_jump(before: int, after: int, bits: int, back: int, silent: int) -> bool:
    """Return whether the step from time `before` to `after` is impossible for a camera, so that a word is damaged.

    That is a decrease by more than `back` or to a negative time, or an increase by more than `silent` across a wrap.
    """
    jump: bool = _native.is_jump(before, after, _checked(bits), back, silent)
    return jump


def _checked(bits: int) -> int:
    if not 1 <= bits <= 61:
        raise ValueError(f"a counter must have 1 to 61 bits, not {bits}")
    return bits


def unwrap(state: np.ndarray, t: np.ndarray, block: int) -> None:
    """Turn the words of a 32-bit counter, `t` int64 [N], into times in place, and advance the state. O(N).

    `block` is the number of records in a block.
    """
    _native.unwrap(state, t, block)


def go_evenly(state: np.ndarray, t: np.ndarray, block: int) -> None:
    """Advance the state by records at times `t` int64 [N] (µs), which never decrease and span less than half a wrap."""
    _native.go_evenly(state, t, block)


def lasting(raw: np.ndarray) -> tuple[int, bool]:
    """Return the time in µs from the first to the last word of a 32-bit counter, and whether a word is damaged.

    `raw` uint32 [N] has the words.
    """
    time: tuple[int, bool] = _native.lasting(raw)
    return time


def extremes(t: np.ndarray, block: int, starts: np.ndarray, lowest: np.ndarray, highest: np.ndarray) -> None:
    """Write the first, smallest and largest time of each block of `block` records at times `t`, int64 [N]. O(N)."""
    _native.extremes(t, block, starts, lowest, highest)


def kept_words(raw: np.ndarray, bits: int, back: int, silent: int = LATEST) -> np.ndarray:
    """Return the mask of the largest set of words without a jump between them (see `is_jump`). O(N log N).

    `raw` int64 [N] has the words of a counter of `bits` bits. `back` and `silent` are the limits of
    `is_jump`, in units of the counter.
    """
    keep = np.empty(raw.size, np.bool_)
    _native.kept_words(raw, _checked(bits), back, silent, keep)
    return keep
