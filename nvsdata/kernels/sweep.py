"""Nearest events where few are near in time: all pairs that are near in time, tested in sequence."""

from __future__ import annotations

import numpy as np

from nvsdata.kernels.compiling import njit

CHUNK = 4096  # pairs that are processed together


@njit
def pairs_in_time(t, reach):
    """Number of pairs that are at most `reach` apart in time. O(N)."""
    pairs = first = 0
    for i in range(t.size):
        while t[i] - t[first] > reach:
            first += 1
        pairs += i - first
    return pairs


@njit
def swept(t, x, y, limit, alpha, beta, k, reach, side, degree, source):
    """Fill the lists of sources of `near_sources`, for events at most `reach` apart in time and `side` along x and y.

    O(N + pairs that are near in time).
    """
    n = t.size
    # row and column in one number, so that one comparison tests both
    place = np.empty(n, np.uint32)
    for i in range(np.uint64(n)):
        place[i] = np.uint32(y[i]) << np.uint32(16) | np.uint32(x[i])
    later, earlier = np.empty(CHUNK + n, np.int32), np.empty(CHUNK + n, np.int32)
    worst = np.empty(n, np.int64)
    first = i = 0
    while i < n:
        i, first, found = _sweep(i, first, t, place, reach, side, later, earlier)
        found = _joined(t, x, y, limit, alpha, beta, later, earlier, found)
        _insert(t, x, y, alpha, beta, later[:found], earlier[:found], k, degree, source, worst)
    for i in range(np.uint64(n)):
        ascend(source, i, degree[i])


@njit
def comes_before(d, dt, j, other_d, other_dt, other):
    """Whether one source of an event is nearer than another: by distance, then time, then index."""
    if d != other_d:
        return d < other_d
    if dt != other_dt:
        return dt < other_dt
    return j < other


@njit
def _sweep(i, first, t, place, reach, side, later, earlier):
    """Pairs of events i, i + 1, ... with near earlier ones (from `first` on), up to a chunk of pairs."""
    # both differences lie in 0..2 side, or in the next power of two, if no bit outside is set
    wide = 1
    while wide < 2 * side + 1:
        wide *= 2
    one = np.uint32(0x10001)
    outside = ~(np.uint32(wide - 1) * one)
    margin = np.uint32(side) * one
    i, first, found = np.uint64(i), np.uint64(first), np.uint64(0)
    while i < np.uint64(t.size) and found < CHUNK:
        while t[i] - t[first] > reach:
            first += np.uint64(1)
        corner = place[i] - margin
        for j in range(first, i):
            later[found] = i
            earlier[found] = j
            # no branch, because which events are near is unpredictable
            found += np.uint64(((place[j] - corner) & outside) == 0)
        i += np.uint64(1)
    return np.int64(i), np.int64(first), np.int64(found)


@njit
def _joined(t, x, y, limit, alpha, beta, later, earlier, found):
    """Keep the pairs within the radius, in place; returns how many."""
    kept = np.uint64(0)
    for k in range(np.uint64(found)):
        i, j = later[k], earlier[k]
        later[kept], earlier[kept] = i, j
        kept += np.uint64(_distance(t, x, y, np.uint64(i), np.uint64(j), alpha, beta) <= limit)
    return np.int64(kept)


@njit
def _insert(t, x, y, alpha, beta, later, earlier, k, degree, source, worst):
    """Add every pair to the lists of both events; in a full list it replaces the furthest source if it is nearer."""
    for pair in range(np.uint64(later.size)):
        target, other = np.uint64(later[pair]), np.uint64(earlier[pair])
        for _ in range(2):
            have = degree[target]
            if have < k:
                source[target, np.uint64(have)] = other
                degree[target] = have + 1
                if have == k - 1:
                    worst[target] = _furthest(t, x, y, target, k, source, alpha, beta)
            elif _is_nearer(t, x, y, target, np.int64(other), source[target, worst[target]], alpha, beta):
                source[target, worst[target]] = other
                worst[target] = _furthest(t, x, y, target, k, source, alpha, beta)
            target, other = other, target


@njit
def _furthest(t, x, y, target, k, source, alpha, beta):
    """Place of the source that a nearer one would replace. O(k)."""
    worst = 0
    for other in range(1, k):
        if _is_nearer(t, x, y, target, source[target, worst], source[target, other], alpha, beta):
            worst = other
    return worst


@njit
def _is_nearer(t, x, y, i, j, other, alpha, beta):
    """Whether event `j` is nearer to `i` than another is."""
    d, other_d = _distance(t, x, y, i, j, alpha, beta), _distance(t, x, y, i, other, alpha, beta)
    return comes_before(d, abs(t[j] - t[i]), j, other_d, abs(t[other] - t[i]), other)


@njit
def _distance(t, x, y, i, j, alpha, beta):
    """Squared distance of eq. 4.2; differences are taken in integers."""
    dx = np.float64(np.int32(x[i]) - np.int32(x[j]))
    dy = np.float64(np.int32(y[i]) - np.int32(y[j]))
    dt = np.float64(t[i] - t[j])
    return alpha * (dx * dx + dy * dy) + beta * (dt * dt)


@njit
def ascend(source, i, count):
    """Sort the first `count` sources of event `i` in place, by insertion, because they are few."""
    one = np.uint64(1)
    for k in range(one, np.uint64(max(count, 1))):
        value, at = source[i, k], k
        while at > 0 and source[i, at - one] > value:
            source[i, at] = source[i, at - one]
            at -= one
        source[i, at] = value
