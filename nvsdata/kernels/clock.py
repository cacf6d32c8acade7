"""Times of counters that wrap, and those among them that no camera wrote.

A counter of few bits tells a time but for whole wraps. The time of a record is taken to be the one next to that of the
record before it, up to half a wrap before or after: so a damaged word moves no other event. Cameras write events
nearly in order, and noise all the time; a step back of more than `BACK_US`, or to before time 0, is damage, and so is
one over a wrap that lasts longer than `SILENT_US`.
"""

from __future__ import annotations

import numpy as np
from numba import njit

BACK_US = 100_000
# No camera is silent for so long, as its noise is not: a longer silence over a wrap is a damaged word's. Within a wrap,
# where it moves no event, any silence is believed
SILENT_US = 300_000_000
ANY = 1 << 62  # a silence of any length
WRAP_US = 1 << 32  # of a 32-bit counter of µs
UNKNOWN = -(1 << 62)  # the time before a counter's first word
NONE = -1

# What is known after some records: the time of the last one and of the last one that began a block, whether that block
# began with many events, whether times fell, the number of the next record, the first that no camera wrote, the first
# after a block that lasted longer than the index can see, and whether records of other kinds than events were seen
LAST, BEGUN, DENSE, FELL, NEXT, JUMP, HIDDEN, MIXED = range(8)
# An index sees how long a block lasts by its first word and the next block's, but for whole wraps. It walks blocks that
# seem to last longer than SOON_US, or no time at all, or whose first PEEK records last longer than PEEK_US
SOON_US, PEEK, PEEK_US = 1 << 26, 16, 100_000


@njit(cache=True, nogil=True)
def clock_at(time, record):
    """The state before `record`, which begins a block and whose time, but for whole wraps, is `time` or unknown."""
    state = np.full(8, NONE, np.int64)
    state[LAST] = state[BEGUN] = time
    state[DENSE] = state[FELL] = state[MIXED] = 0
    state[NEXT] = record
    return state


@njit(cache=True, nogil=True, inline="always")
def nearest(raw, last, bits):
    """The time next to `last` that a counter of `bits` bits shows as `raw`."""
    half = np.int64(1) << (bits - 1)
    return last + ((np.int64(raw) - last + half) & (2 * half - 1)) - half


@njit(cache=True, nogil=True, inline="always")
def first_time(raw, bits):
    """The time of a first word: as it stands, but -1 for 28 ones or more, which is what lost memory holds."""
    return np.int64(-1) if bits > 12 and np.int64(raw) == (np.int64(1) << bits) - 1 else np.int64(raw)


@njit(cache=True, nogil=True, inline="always")
def is_jump(before, after, bits, back, silent):
    """Whether no camera goes on at `after`: `back` too far, before 0, or over a wrap by more than `silent`."""
    step = after - before
    return step < -back or after < 0 or (step > silent and after >> bits != before >> bits)


@njit(cache=True, nogil=True)
def begin(state, raw):
    """Tell the state of the first word of a 32-bit counter, unless it knows the time."""
    if state[LAST] == UNKNOWN:
        state[LAST] = state[BEGUN] = max(first_time(raw, 32), 0)


@njit(cache=True, nogil=True)
def unwrap(state, t, block):
    """Turn the words of a 32-bit counter, `t` int64 [N], into times, and go on by those records. O(N)."""
    if t.size == 0:
        return
    begin(state, t[0])
    time = state[LAST]
    shown = time & (WRAP_US - 1)
    falls = jumps = 0
    for i in range(np.uint64(t.size)):
        word = t[i]
        step = np.int64(np.int32(word - shown))
        time += step
        t[i] = time
        falls += step < 0
        # a step forward to a lesser word goes over a wrap
        jumps += (step < -BACK_US) | (time < 0) | ((step > SILENT_US) & (word < shown))
        shown = word
    if falls:
        state[FELL] = 1
    if jumps and state[JUMP] < 0:
        i = 0
        last = state[LAST]
        while not is_jump(last, t[i], 32, BACK_US, SILENT_US):
            last = t[i]
            i += 1
        state[JUMP] = state[NEXT] + i
    _pass_blocks(state, t, block)


@njit(cache=True, nogil=True)
def go_evenly(state, t, block):
    """Go on by records of times `t` [N], not empty, that never fall and end less than half a wrap after they begin."""
    begin(state, t[0])
    if t[0] < state[LAST]:
        state[FELL] = 1
    if is_jump(state[LAST], t[0], 32, BACK_US, SILENT_US) and state[JUMP] < 0:
        state[JUMP] = state[NEXT]
    _pass_blocks(state, t, block)


@njit(cache=True, nogil=True)
def _pass_blocks(state, t, block):
    first = state[NEXT]
    for i in range((block - first % block) % block, t.size, block):
        # what the first words of the last block and of this one say of the time between them
        shown = nearest(t[i], state[BEGUN], 32) - state[BEGUN]
        if state[DENSE] and shown != t[i] - state[BEGUN] and 0 < shown <= SOON_US and state[HIDDEN] < 0:
            state[HIDDEN] = first + i
        state[BEGUN] = t[i]
        state[DENSE] = i + PEEK <= t.size and t[i + PEEK - 1] - t[i] <= PEEK_US
    state[LAST] = t[-1]
    state[NEXT] = first + t.size


@njit(cache=True, nogil=True)
def lasting(raw):
    """µs from the first to the last of a 32-bit counter's words, uint32 [N]; whether a wrap is a damaged word's."""
    time = np.int64(raw[0])
    damaged = False
    for i in range(1, raw.size):
        before, time = time, nearest(raw[i], time, 32)
        damaged |= time - before > SILENT_US and raw[i] < raw[i - 1]
    return time - np.int64(raw[0]), damaged


@njit(cache=True, nogil=True)
def extremes(t, block, starts, lowest, highest):
    """First, lowest and highest time of blocks of records: of as many as there are of `t`, int64 [N]. O(N)."""
    for k in range((t.size + block - 1) // block):
        part = t[k * block : (k + 1) * block]
        starts[k], lowest[k], highest[k] = part[0], part.min(), part.max()


@njit(cache=True, nogil=True)
def kept_words(raw, bits, back, silent=ANY):
    """The most words between which no time jumps (see `is_jump`), as a mask. O(N log N).

    `raw` int64 [N] shows a counter of `bits` bits; `back` and `silent` are in its units.
    """
    n = raw.size
    if n == 0:
        return np.zeros(0, np.bool_)
    raw = raw & ((np.int64(1) << bits) - 1)
    # runs of words without a jump are kept or dropped as one
    run, since = np.zeros(n, np.int64), np.zeros(n, np.int64)
    for i in range(1, n):
        step = nearest(raw[i], raw[i - 1], bits) - raw[i - 1]
        alone = first_time(raw[i], bits) < 0 or first_time(raw[i - 1], bits) < 0
        if alone or abs(step) > back:
            run[i] = run[i - 1] + 1
        else:
            run[i], since[i] = run[i - 1], since[i - 1] + step
    count = run[-1] + 1
    first, last, span = np.empty(count, np.int64), np.empty(count, np.int64), np.empty(count, np.int64)
    weight = np.zeros(count, np.int64)
    for i in range(n):
        if weight[run[i]] == 0:
            first[run[i]] = raw[i]
        last[run[i]], span[run[i]] = raw[i], since[i]
        weight[run[i]] += 1
    time = _heaviest_chain(first, last, span, weight, bits, back, silent)
    keep = np.empty(n, np.bool_)
    for i in range(n):
        keep[i] = time[run[i]] != UNKNOWN and time[run[i]] + since[i] >= 0
    return keep


@njit(cache=True, nogil=True)
def _heaviest_chain(first, last, span, weight, bits, back, silent):
    """The times at which runs begin that make the heaviest chain without a jump; UNKNOWN of the others.

    A run's `first` and `last` word lie `span` apart. A first word of all ones begins no chain.
    """
    n = first.size
    wrap = np.int64(1) << bits
    ahead = wrap // 2 - 1
    order = np.argsort(last)
    ends = last[order]
    rank = np.empty(n, np.int64)
    rank[order] = np.arange(n)
    # a tree over the ends: the best chain so far of those in a range
    best = np.full(2 * n, -1, np.int64)
    total, time, end = np.zeros(n, np.int64), np.empty(n, np.int64), np.empty(n, np.int64)
    before = np.full(n, -1, np.int64)
    top = np.int64(-1)
    for k in range(n):
        word = first[k]
        # last words that it may follow: of its own wrap, of the one before, and, stepping back, of the one after
        for low, high in (
            (word - ahead, word + back),
            (word + wrap - min(silent, ahead), wrap - 1),
            (np.int64(0), word - wrap + back),
        ):
            lo, hi = np.searchsorted(ends, low, "left"), np.searchsorted(ends, high, "right")
            before[k] = _best_of(best, total, end, lo, hi, before[k])
        if before[k] >= 0:
            time[k] = nearest(word, end[before[k]], bits)
            total[k] = total[before[k]] + weight[k]
        elif first_time(word, bits) >= 0:
            time[k] = word
            total[k] = weight[k]
        else:
            continue
        end[k] = time[k] + span[k]
        # of a last word far ahead and one that goes on, the latter
        if top < 0 or total[k] > total[top] or (total[k] == total[top] and end[k] < end[top]):
            top = k
        i = rank[k] + n
        while i > 0:
            if _is_better(k, best[i], total, end):
                best[i] = k
            i >>= 1
    chosen = np.full(n, UNKNOWN, np.int64)
    while top >= 0:
        chosen[top] = time[top]
        top = before[top]
    return chosen


@njit(cache=True, nogil=True, inline="always")
def _is_better(k, other, total, end):
    """Whether chain `k` is heavier than the other, or as heavy and nearer to what follows; -1 is no chain."""
    return k >= 0 and (other < 0 or total[k] > total[other] or (total[k] == total[other] and end[k] > end[other]))


@njit(cache=True, nogil=True)
def _best_of(best, total, end, lo, hi, found):
    """The best of the chains at places lo..hi of the tree's leaves, and of the one that was found."""
    lo += best.size // 2
    hi += best.size // 2
    while lo < hi:
        if lo & 1:
            found = best[lo] if _is_better(best[lo], found, total, end) else found
            lo += 1
        if hi & 1:
            hi -= 1
            found = best[hi] if _is_better(best[hi], found, total, end) else found
        lo >>= 1
        hi >>= 1
    return found
