"""Times of counters that wrap, and times among them that no camera wrote.

A counter of few bits gives a time only up to whole wraps. The time of a record is taken to be the one nearest to that
of the record before it, at most half a wrap earlier or later: so a damaged word moves no other event. Cameras write
events nearly in order, and noise all the time. So a step back of more than `BACK_US`, or to before time 0, is damage,
and so is a step across a wrap that lasts longer than `SILENT_US`.
"""

from __future__ import annotations

import numpy as np

from nvsdata.kernels.compiling import njit

BACK_US = 100_000
# No camera is silent for longer, because of its noise: a longer silence across a wrap comes from a damaged word. Within
# a wrap, where it moves no other event, a silence of any length is accepted
SILENT_US = 300_000_000
ANY = 1 << 62  # a silence of any length
WRAP_US = 1 << 32  # wrap of a 32-bit counter of µs
UNKNOWN = -(1 << 62)  # the time before a counter's first word
NONE = -1

# The state after some records: the time of the last one, and of the last one that began a block; whether that block
# began with many events; whether times fell; the number of the next record, of the first that no camera wrote, and of
# the first after a block that lasted longer than the index can see; whether records other than events were seen
LAST, BEGUN, DENSE, FELL, NEXT, JUMP, HIDDEN, MIXED = range(8)
# An index finds how long a block lasts, up to whole wraps, from its first word and the next block's. It reads all words
# of blocks that seem to last longer than SOON_US, or no time, or whose first PEEK records last longer than PEEK_US
SOON_US, PEEK, PEEK_US = 1 << 26, 16, 100_000


@njit
def clock_at(time, record):
    """The state before `record`, the first of a block, whose time up to whole wraps is `time` or UNKNOWN."""
    state = np.full(8, NONE, np.int64)
    state[LAST] = state[BEGUN] = time
    state[DENSE] = state[FELL] = state[MIXED] = 0
    state[NEXT] = record
    return state


@njit(inline="always")
def nearest(raw, last, bits):
    """The time nearest to `last` that a counter of `bits` bits shows as `raw`."""
    half = np.int64(1) << (bits - 1)
    return last + ((np.int64(raw) - last + half) & (2 * half - 1)) - half


@njit(inline="always")
def first_time(raw, bits):
    """The time of a first word: its value, but -1 for 28 ones or more, which is what lost memory holds."""
    return np.int64(-1) if bits > 12 and np.int64(raw) == (np.int64(1) << bits) - 1 else np.int64(raw)


@njit(inline="always")
def is_jump(before, after, bits, back, silent):
    """Whether no camera continues at `after`: over `back` earlier, before 0, or across a wrap by over `silent`."""
    step = after - before
    return step < -back or after < 0 or (step > silent and after >> bits != before >> bits)


@njit
def begin(state, raw):
    """Set the state's time from the first word of a 32-bit counter, unless it is known."""
    if state[LAST] == UNKNOWN:
        state[LAST] = state[BEGUN] = max(first_time(raw, 32), 0)


@njit
def unwrap(state, t, block):
    """Turn the words of a 32-bit counter, `t` int64 [N], into times in place, and advance the state. O(N)."""
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
        # a step forward to a smaller word crosses a wrap
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


@njit
def go_evenly(state, t, block):
    """Advance the state by records of times `t` [N], N > 0, that never fall and span less than half a wrap."""
    begin(state, t[0])
    if t[0] < state[LAST]:
        state[FELL] = 1
    if is_jump(state[LAST], t[0], 32, BACK_US, SILENT_US) and state[JUMP] < 0:
        state[JUMP] = state[NEXT]
    _pass_blocks(state, t, block)


@njit
def _pass_blocks(state, t, block):
    first = state[NEXT]
    for i in range((block - first % block) % block, t.size, block):
        # the time between the first words of the last block and of this one, as an index sees it
        shown = nearest(t[i], state[BEGUN], 32) - state[BEGUN]
        if state[DENSE] and shown != t[i] - state[BEGUN] and 0 < shown <= SOON_US and state[HIDDEN] < 0:
            state[HIDDEN] = first + i
        state[BEGUN] = t[i]
        state[DENSE] = i + PEEK <= t.size and t[i + PEEK - 1] - t[i] <= PEEK_US
    state[LAST] = t[-1]
    state[NEXT] = first + t.size


@njit
def lasting(raw):
    """µs from the first to the last of a 32-bit counter's words, uint32 [N]; and whether a word is damaged."""
    time = np.int64(raw[0])
    damaged = False
    for i in range(1, raw.size):
        before, time = time, nearest(raw[i], time, 32)
        damaged |= time - before > SILENT_US and raw[i] < raw[i - 1]
    return time - np.int64(raw[0]), damaged


@njit
def extremes(t, block, starts, lowest, highest):
    """First, lowest and highest time of each block of `block` records in `t`, int64 [N]. O(N)."""
    for k in range((t.size + block - 1) // block):
        part = t[k * block : (k + 1) * block]
        starts[k], lowest[k], highest[k] = part[0], part.min(), part.max()


@njit
def kept_words(raw, bits, back, silent=ANY):
    """Mask of the largest set of words without a jump between them (see `is_jump`). O(N log N).

    `raw` int64 [N] shows a counter of `bits` bits; `back` and `silent` are in its units.
    """
    n = raw.size
    if n == 0:
        return np.zeros(0, np.bool_)
    raw = raw & ((np.int64(1) << bits) - 1)
    # a run of words without a jump is kept or dropped as a whole
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


@njit
def _heaviest_chain(first, last, span, weight, bits, back, silent):
    """Start times of the runs that form the heaviest chain without a jump; UNKNOWN for the other runs.

    A run's `first` and `last` word lie `span` apart. A first word of all ones begins no chain.
    """
    n = first.size
    wrap = np.int64(1) << bits
    ahead = wrap // 2 - 1
    order = np.argsort(last)
    ends = last[order]
    rank = np.empty(n, np.int64)
    rank[order] = np.arange(n)
    # a tree over the ends of runs: the best chain so far that ends in a range
    best = np.full(2 * n, -1, np.int64)
    total, time, end = np.zeros(n, np.int64), np.empty(n, np.int64), np.empty(n, np.int64)
    before = np.full(n, -1, np.int64)
    top = np.int64(-1)
    for k in range(n):
        word = first[k]
        # last words that a run may follow: in its own wrap, the one before and, for a step back, the one after
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
        # between a last word far ahead and one that continues, take the latter
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


@njit(inline="always")
def _is_better(k, other, total, end):
    """Whether chain `k` is heavier than `other`, or as heavy and nearer to the next run; -1: no chain."""
    return k >= 0 and (other < 0 or total[k] > total[other] or (total[k] == total[other] and end[k] > end[other]))


@njit
def _best_of(best, total, end, lo, hi, found):
    """The best of the chain `found` and those at the tree's leaves lo..hi."""
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
