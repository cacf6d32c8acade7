"""Nearest events where none is nearer in time than another in space: whole rings of pixels around a pixel."""

from __future__ import annotations

import numpy as np

from nvsdata.kernels.bits import SHIFT, mark, trailing_zeros
from nvsdata.kernels.compiling import njit

FEW = 144  # squared number of events up to which insertion sorts faster than bit sets


@njit
def by_rings(pixel, m, total, k, t, order, first, near, apart, marked, used, whole, last, both, at, degree, source):
    """Sources of a pixel's events where no time makes up for a difference in space, and all are near enough in time.

    Whole rings of pixels are sources of all the pixel's events; of the last ring each event takes those that are
    nearest to it in time, which lie side by side. A row of `source` has room for one more than `k`.
    """
    # near[:q] are the pixels of whole rings, near[q:m] those of the last one
    q, left = m, np.int64(k + 1)
    if total > left:
        left -= total
        while q and apart[q - 1] == apart[m - 1]:
            q -= 1
            left += first[near[q] + 1] - first[near[q]]
    if q == m and total * total <= FEW + used.size:
        wholes, lasts = _few(m, order, first, near, whole), np.uint64(0)
    else:
        _mark(0, q, order, first, near, marked[0], used)
        _mark(q, m, order, first, near, marked[1], used)
        wholes, lasts = _listed(marked, used, whole, last, both, at)
    left = min(np.uint64(left), lasts)
    one, own, none = np.uint64(1), q == 0, np.uint64(0)
    chosen = none
    for e in range(np.uint64(first[pixel]), np.uint64(first[pixel + 1])):
        i = np.uint64(order[e])
        n = done = none
        if left:
            while chosen + left < lasts and _is_no_further(t[last[chosen + left]], t[last[chosen]], t[i]):
                chosen += one
            b, pause, skipped, end = _smallest_first(chosen, left, lasts, last, t, i, own)
            # of the last ring from one place up to another, and what whole rings have in between
            if b < pause:
                n = _copied(whole, none, at[b] - b, source, i, n)
                n = _copied(both, at[b], at[pause - one] + one, source, i, n)
                done = at[pause - one] + one - pause
            if skipped < end:
                n = _copied(whole, done, at[skipped] - skipped, source, i, n)
                n = _copied(both, at[skipped], at[end - one] + one, source, i, n)
                done = at[end - one] + one - end
        degree[i] = _copied(whole, done, wholes, source, i, n)


@njit
def _few(m, order, first, near, whole):
    """List the events of the near pixels, ascending: how many. By insertion, so they should be few."""
    one = np.uint64(1)
    n = np.uint64(0)
    for p in range(np.uint64(m)):
        pixel = np.uint64(near[p])
        for e in range(np.uint64(first[pixel]), np.uint64(first[pixel + one])):
            event, at = order[e], n
            while at > 0 and whole[at - one] > event:
                whole[at] = whole[at - one]
                at -= one
            whole[at] = event
            n += one
    return n


@njit
def _mark(q, stop, order, first, near, marked, used):
    """Set the bits of the events of the near pixels from `q` up to `stop`."""
    one = np.uint64(1)
    for p in range(np.uint64(q), np.uint64(stop)):
        pixel = np.uint64(near[p])
        for e in range(np.uint64(first[pixel]), np.uint64(first[pixel + one])):
            mark(np.uint64(order[e]), marked, used)


@njit
def _listed(marked, used, whole, last, both, at):
    """Turn bit sets into ascending lists, and empty them: how many events of whole rings there are, and of the last.

    `both` gets the events of both lists, `at` the places there of the last ring's. O(events + N / 4096).
    """
    one = np.uint64(1)
    n = lasts = np.uint64(0)
    for group in range(np.uint64(used.size)):
        words = used[group]
        used[group] = 0
        while words:
            word = (group << SHIFT) | trailing_zeros(words)
            words &= words - one
            lasting = marked[1, word]
            bits = marked[0, word] | lasting
            marked[0, word] = marked[1, word] = 0
            while bits:
                bit = trailing_zeros(bits)
                bits &= bits - one
                event = (word << SHIFT) | bit
                # no branch, because which events are the last ring's is unpredictable
                both[n] = whole[n - lasts] = last[lasts] = event
                at[lasts] = n
                lasts += (lasting >> bit) & one
                n += one
    return n - lasts, lasts


@njit
def _copied(events, start, stop, source, i, n):
    """Put events from `start` up to `stop` into the row of event `i`, without itself, from `n` on: the new length."""
    for q in range(start, stop):
        source[i, n] = events[q]
        n += np.uint64(np.uint64(events[q]) != i)
    return n


@njit
def _is_no_further(later, earlier, time):
    """Whether the later of two times is nearer to `time`, or the same as the earlier one: then either will do."""
    return later == earlier or abs(later - time) < abs(earlier - time)


@njit
def _smallest_first(chosen, left, lasts, last, t, i, own):
    """Of equally near events those of smallest index, where `left` events from `chosen` on are nearest to event `i`.

    Returns the places to take: from the first number up to the second, and from the third up to the fourth. `own` says
    whether `i` is among the events.
    """
    end = chosen + left
    if left == 0 or ((chosen == 0 or t[last[chosen - np.uint64(1)]] != t[last[chosen]]) and not own):
        return chosen, end, end, end
    # only the first of the chosen may have equals before them
    time = t[last[chosen]]
    begin = first_at(t, last, np.uint64(0), chosen, time)
    stop = first_at(t, last, chosen, end, time + 1)
    count = stop - chosen
    if own and time == t[i]:
        # one of them is `i` itself, or stands for it
        others = count - np.uint64(1)
        count = others + np.uint64(others > 0 and last[begin + others - np.uint64(1)] >= i)
    if count == 0:
        begin = stop
    return begin, begin + count, stop, end


@njit
def first_at(t, order, low, high, time):
    """First place from `low` up to `high` of an event at `time` or later, `high` if there is none. O(log N)."""
    while low < high:
        middle = (low + high) >> np.uint64(1)
        if t[order[middle]] < time:
            low = middle + np.uint64(1)
        else:
            high = middle
    return low
