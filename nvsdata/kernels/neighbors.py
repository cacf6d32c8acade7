"""Radius graphs of events."""

from __future__ import annotations

import numpy as np
from numba import njit

SWEEP = 48  # mean number of events within reach in time; up to this, cells aren't worth maintaining
CHUNK = 4096  # pairs that are processed together


@njit(cache=True, nogil=True)
def radius_edges(t, x, y, radius, alpha, beta, max_degree, sweep_below=SWEEP):
    """Edges of the radius graph: int64 [2, E], rows source and target, sorted by (target, source).

    Events i != j are joined if alpha (dx² + dy²) + beta dt² <= radius². A target keeps its
    `max_degree` nearest sources by (distance, index). `t` must not decrease. If on average fewer than
    `sweep_below` events are within reach in time, all of them are tested;
    otherwise only those in neighboring cells.
    O(N · events within reach of one) time, O(N · max_degree) memory.
    """
    n = t.size
    limit = radius * radius
    reach_t = np.int64(2**62)
    if beta > 0 and np.sqrt(limit / beta) < 4e18:
        reach_t = np.int64(np.sqrt(limit / beta)) + 1
    x0, y0, across, down, cell = _cells(x, y, radius, alpha)
    sweep = _pairs_in_time(t, reach_t) <= sweep_below * n
    # row and column in one number, so that one comparison tests both
    place = np.empty(n, np.uint32)
    for i in range(np.uint64(n)):
        place[i] = np.uint32(y[i]) << np.uint32(16) | np.uint32(x[i])
    home = np.empty(0 if sweep else n, np.int64)
    for i in range(home.size):
        home[i] = ((y[i] - y0) // cell + 1) * (across + 2) + (x[i] - x0) // cell + 1
    # in a busy scene events are put into cells of the size of the spatial reach; within a cell they form
    # a list from the latest back, so that the search stops at the first event that is too old
    head = np.full(0 if sweep else (down + 2) * (across + 2), -1, np.int64)
    previous = np.empty(home.size, np.int64)
    later, earlier = np.empty(CHUNK + n, np.int32), np.empty(CHUNK + n, np.int32)
    degree = np.zeros(n, np.int64)
    source = np.empty((n, max_degree), np.int32)
    worst = np.empty(n, np.int64)
    first = i = 0
    while i < n:
        if sweep:
            i, first, found = _sweep(i, first, t, place, reach_t, cell, later, earlier)
        else:
            i, found = _visit_cells(i, t, reach_t, home, across + 2, head, previous, later, earlier)
        found = _joined(t, x, y, limit, alpha, beta, later, earlier, found)
        _insert(t, x, y, alpha, beta, later[:found], earlier[:found], degree, source, worst)
    return _by_target(degree, source)


@njit(cache=True, nogil=True)
def _sweep(i, first, t, place, reach_t, cell, later, earlier):
    """Pairs of events i, i + 1, ... with near earlier ones (from `first` on), up to a chunk of pairs."""
    # both differences lie in 0..2 cell, or in the next power of two, if no bit outside is set
    wide = 1
    while wide < 2 * cell + 1:
        wide *= 2
    one = np.uint32(0x10001)
    outside = ~(np.uint32(wide - 1) * one)
    margin = np.uint32(cell) * one
    i, first, found = np.uint64(i), np.uint64(first), np.uint64(0)
    while i < np.uint64(t.size) and found < CHUNK:
        while t[i] - t[first] > reach_t:
            first += np.uint64(1)
        corner = place[i] - margin
        for j in range(first, i):
            later[found] = i
            earlier[found] = j
            # no branch, because which events are near is unpredictable
            found += np.uint64(((place[j] - corner) & outside) == 0)
        i += np.uint64(1)
    return np.int64(i), np.int64(first), np.int64(found)


@njit(cache=True, nogil=True)
def _visit_cells(i, t, reach_t, home, across, head, previous, later, earlier):
    """Pairs of events i, i + 1, ... with earlier ones in neighboring cells, up to a chunk of pairs."""
    found = 0
    while i < t.size and found < CHUNK:
        for below in range(-1, 2):
            for right in range(-1, 2):
                k = head[home[i] + below * across + right]
                while k >= 0 and t[i] - t[k] <= reach_t:
                    later[found], earlier[found] = i, k
                    found += 1
                    k = previous[k]
        previous[i] = head[home[i]]
        head[home[i]] = i
        i += 1
    return i, found


@njit(cache=True, nogil=True)
def _joined(t, x, y, limit, alpha, beta, later, earlier, found):
    """Keep the pairs within the radius, in place; returns how many."""
    kept = np.uint64(0)
    for k in range(np.uint64(found)):
        i, j = later[k], earlier[k]
        later[kept], earlier[kept] = i, j
        kept += np.uint64(_distance(t, x, y, np.uint64(i), np.uint64(j), alpha, beta) <= limit)
    return np.int64(kept)


@njit(cache=True, nogil=True)
def _insert(t, x, y, alpha, beta, later, earlier, degree, source, worst):
    """Add every pair to the lists of both events; in a full list it replaces the furthest source if it is nearer."""
    max_degree = source.shape[1]
    for k in range(np.uint64(later.size)):
        target, other = np.uint64(later[k]), np.uint64(earlier[k])
        for _ in range(2):
            have = degree[target]
            if have < max_degree:
                source[target, np.uint64(have)] = other
                degree[target] = have + 1
                if have == max_degree - 1:
                    worst[target] = _furthest(t, x, y, target, source, alpha, beta)
            else:
                rival = np.uint64(source[target, worst[target]])
                d = _distance(t, x, y, target, other, alpha, beta)
                most = _distance(t, x, y, target, rival, alpha, beta)
                if d < most or (d == most and other < rival):
                    source[target, worst[target]] = other
                    worst[target] = _furthest(t, x, y, target, source, alpha, beta)
            target, other = other, target


@njit(cache=True, nogil=True)
def nearest_edges(t, x, y, alpha, beta):
    """Edges to each event from its nearest event: int64 [2, N], or [2, 0] for fewer than two. `t` int64, sorted.

    Nearest by alpha (dx² + dy²) + beta dt², then by index. The search goes outward in time until the time difference
    alone is further: O(N x events within that time).
    """
    n = t.size
    edges = np.empty((2, n if n > 1 else 0), np.int64)
    for i in range(edges.shape[1]):
        best, nearest = np.inf, -1
        before, after = i - 1, i + 1
        while before >= 0 or after < n:
            if before >= 0:
                if beta * float(t[i] - t[before]) ** 2 > best:
                    before = -1
                else:
                    far = _distance(t, x, y, i, before, alpha, beta)
                    # of equals the smaller index; indices only get smaller here
                    if far <= best:
                        best, nearest = far, before
                    before -= 1
            if after < n:
                if beta * float(t[after] - t[i]) ** 2 > best:
                    after = n
                else:
                    far = _distance(t, x, y, i, after, alpha, beta)
                    if far < best:
                        best, nearest = far, after
                    after += 1
        edges[0, i], edges[1, i] = nearest, i
    return edges


@njit(cache=True, nogil=True)
def _distance(t, x, y, i, j, alpha, beta):
    """Squared distance of eq. 4.2; differences are taken in integers."""
    dx = np.float64(np.int32(x[i]) - np.int32(x[j]))
    dy = np.float64(np.int32(y[i]) - np.int32(y[j]))
    dt = np.float64(t[i] - t[j])
    return alpha * (dx * dx + dy * dy) + beta * (dt * dt)


@njit(cache=True, nogil=True)
def _pairs_in_time(t, reach_t):
    """Number of pairs that are at most reach_t apart in time. O(N)."""
    pairs = 0
    first = 0
    for i in range(t.size):
        while t[i] - t[first] > reach_t:
            first += 1
        pairs += i - first
    return pairs


@njit(cache=True, nogil=True)
def _cells(x, y, radius, alpha):
    """Origin, number of columns and rows, and side of the cells (at least the spatial reach)."""
    if x.size == 0:
        return np.int64(0), np.int64(0), np.int64(1), np.int64(1), np.int64(1)
    x0, x1, y0, y1 = np.int64(x[0]), np.int64(x[0]), np.int64(y[0]), np.int64(y[0])
    for i in range(1, x.size):
        x0, x1 = min(x0, np.int64(x[i])), max(x1, np.int64(x[i]))
        y0, y1 = min(y0, np.int64(y[i])), max(y1, np.int64(y[i]))
    widest = max(x1 - x0, y1 - y0) + 1
    reach = np.float64(widest) if alpha == 0 else radius / np.sqrt(alpha)
    # coordinates are whole, so none lies between floor(reach) and reach; at most 2^20 cells
    cell = np.int64(max(1.0, widest / 1024, min(np.floor(reach * (1 + 1e-12)), np.float64(widest))))
    cell += np.int64(cell * 1024 < widest)
    return x0, y0, (x1 - x0) // cell + 1, (y1 - y0) // cell + 1, cell


@njit(cache=True, nogil=True)
def _furthest(t, x, y, target, source, alpha, beta):
    """Index of the source that a nearer one would replace. O(max_degree)."""
    worst, most = 0, -1.0
    for k in range(source.shape[1]):
        j = source[target, k]
        d = _distance(t, x, y, target, j, alpha, beta)
        if d > most or (d == most and j > source[target, worst]):
            worst, most = k, d
    return worst


@njit(cache=True, nogil=True)
def _by_target(degree, source):
    """Edges, sorted by (target, source), from lists of sources."""
    edges = np.empty((2, degree.sum()), np.int64)
    e = np.uint64(0)
    for i in range(np.uint64(degree.size)):
        first = e
        for k in range(np.uint64(degree[i])):
            edges[0, e], edges[1, e] = source[i, k], i
            e += np.uint64(1)
        _ascend(edges[0], first, e)
    return edges


@njit(cache=True, nogil=True)
def _ascend(values, lo, hi):
    """Sort values[lo:hi] in place by insertion, because they are few and nearly sorted."""
    one = np.uint64(1)
    for i in range(lo, hi):
        value = values[i]
        at = i
        while at > lo and values[at - one] > value:
            values[at] = values[at - one]
            at -= one
        values[at] = value
