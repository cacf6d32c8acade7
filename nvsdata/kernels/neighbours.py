"""Radius graphs of events."""

from __future__ import annotations

import numpy as np
from numba import njit

SWEEP = 48  # mean number of events within reach in time up to which no cells are worth their upkeep


@njit(cache=True, nogil=True)
def radius_edges(t, x, y, radius, alpha, beta, max_degree, sweep_below=SWEEP):
    """Edges of the radius graph: int64 [2, E], rows source and target, sorted by (target, source).

    Events i != j are joined if alpha (dx² + dy²) + beta dt² <= radius². A target keeps its
    `max_degree` nearest sources by (distance, index). `t` must not decrease. Where fewer than
    `sweep_below` events, on average, are within reach in time, all of them are looked at;
    otherwise only those in the cells around.
    O(N · events within reach of one) time, O(N · max_degree) memory.
    """
    n = t.size
    limit = radius * radius
    reach_t = np.int64(2**62)
    if beta > 0 and np.sqrt(limit / beta) < 4e18:
        reach_t = np.int64(np.sqrt(limit / beta)) + 1
    x0, y0, across, down, cell = _cells(x, y, radius, alpha)
    # unsigned indices spare numba's test for negative ones in the inner loops
    column, row = x.astype(np.int32), y.astype(np.int32)
    degree = np.zeros(n, np.int64)
    source = np.empty((n, max_degree), np.int32)
    worst = np.empty(n, np.int64)
    limits = np.empty(n, np.float64)
    near = np.empty(n, np.int32)
    sweep = _pairs_in_time(t, reach_t) <= sweep_below * n
    # in a busy scene events are hashed into cells of the spatial reach; within a cell they form a
    # list from the latest back, so that the search stops at the first event that is too old
    head = np.full(0 if sweep else (down + 2) * (across + 2), -1, np.int64)
    previous = np.empty(0 if sweep else n, np.int64)
    first = np.uint64(0)
    for i in range(np.uint64(n)):
        count = np.uint64(0)
        if sweep:
            while t[i] - t[first] > reach_t:
                first += np.uint64(1)
            left, top = column[i] - np.int32(cell), row[i] - np.int32(cell)
            for j in range(first, i):
                near[count] = j
                # no branch: which events are near is beyond any predictor
                count += np.uint64(
                    (np.uint32(column[j] - left) <= np.uint32(2 * cell))
                    & (np.uint32(row[j] - top) <= np.uint32(2 * cell))
                )
        else:
            home = ((row[i] - y0) // cell + 1) * (across + 2) + (column[i] - x0) // cell + 1
            for below in range(-1, 2):
                for right in range(-1, 2):
                    k = head[home + below * (across + 2) + right]
                    while k >= 0 and t[i] - t[k] <= reach_t:
                        near[count] = k
                        count += np.uint64(1)
                        k = previous[k]
            previous[i] = head[home]
            head[home] = i
        for c in range(count):
            j = np.uint64(near[c])
            dx, dy = np.float64(column[i] - column[j]), np.float64(row[i] - row[j])
            dt = np.float64(t[i] - t[j])
            d = alpha * (dx * dx + dy * dy) + beta * (dt * dt)
            if d > limit:
                continue
            target, other = i, j
            for _ in range(2):
                have = degree[target]
                if have < max_degree:
                    source[target, np.uint64(have)] = other
                    degree[target] = have + 1
                elif d < limits[target] or (d == limits[target] and other < source[target, worst[target]]):
                    source[target, worst[target]] = other
                else:
                    have = -1
                if have >= max_degree - 1:
                    worst[target], limits[target] = _furthest(t, x, y, target, source, alpha, beta)
                target, other = j, i
    return _by_target(degree, source)


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
    # whole coordinates: nothing lies between floor(reach) and reach; never more than 2^20 cells
    cell = np.int64(max(1.0, widest / 1024, min(np.floor(reach * (1 + 1e-12)), np.float64(widest))))
    cell += np.int64(cell * 1024 < widest)
    return x0, y0, (x1 - x0) // cell + 1, (y1 - y0) // cell + 1, cell


@njit(cache=True, nogil=True)
def _furthest(t, x, y, target, source, alpha, beta):
    """Place and squared distance of the source that a nearer one would replace. O(max_degree)."""
    worst, most = 0, -1.0
    for k in range(source.shape[1]):
        j = source[target, k]
        dx = np.float64(np.int64(x[target]) - np.int64(x[j]))
        dy = np.float64(np.int64(y[target]) - np.int64(y[j]))
        dt = np.float64(t[target] - t[j])
        d = alpha * (dx * dx + dy * dy) + beta * (dt * dt)
        if d > most or (d == most and j > source[target, worst]):
            worst, most = k, d
    return worst, most


@njit(cache=True, nogil=True)
def _by_target(degree, source):
    """Lists of sources to sorted edges; insertion sort, for lists are short and nearly sorted."""
    edges = np.empty((2, degree.sum()), np.int64)
    one = np.uint64(1)
    e = np.uint64(0)
    for i in range(np.uint64(degree.size)):
        first = e
        for k in range(np.uint64(degree[i])):
            j = np.int64(source[i, k])
            at = e
            while at > first and edges[0, at - one] > j:
                edges[0, at] = edges[0, at - one]
                at -= one
            edges[0, at] = j
            edges[1, e] = i
            e += one
    return edges
