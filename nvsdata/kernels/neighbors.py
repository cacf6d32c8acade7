"""The nearest events of each event, in space and time."""

from __future__ import annotations

import numpy as np

from nvsdata.kernels.bits import bit_sets
from nvsdata.kernels.compiling import njit
from nvsdata.kernels.pixels import FAR, TABLE, by_pixel, flat_map, near_pixels, offsets_within
from nvsdata.kernels.rings import by_rings, first_at
from nvsdata.kernels.sweep import ascend, comes_before, pairs_in_time, swept

SWEEP = 48  # mean number of events near in time up to which testing all of them is fastest
ROUNDING = 1e-12  # by how much more than a rounded bound is searched


@njit
def near_edges(t, x, y, radius, alpha, beta, k, sweep_below=SWEEP):
    """Edges to each event from its near ones, see `near_sources`: int64 [2, E], sorted by (target, source)."""
    degree, source = near_sources(t, x, y, radius, alpha, beta, k, sweep_below)
    edges = np.empty((2, degree.sum()), np.int64)
    e = np.uint64(0)
    for i in range(np.uint64(degree.size)):
        for j in range(np.uint64(degree[i])):
            edges[0, e], edges[1, e] = source[i, j], i
            e += np.uint64(1)
    return edges


@njit
def near_sources(t, x, y, radius, alpha, beta, k, sweep_below=SWEEP):
    """The `k` nearest others within `radius` of each event: how many, int32 [N], and in each row which, ascending.

    The squared distance is alpha (dx² + dy²) + beta dt²; of equals the one nearer in time is nearer, then the one
    of smaller index, as in the author's released graphs. `t` int64 must not decrease, `x` and `y` not be negative;
    `radius` may be infinite if alpha > 0.

    O(N (pixels within the distance of the k-th + k)), however many events a pixel has, where no time makes up for a
    difference in space; otherwise k² takes the place of k. O(N k) memory. If on average fewer than `sweep_below` events
    are near in time, those are tested instead.
    """
    n = t.size
    k = max(min(k, n - 1), 1)
    limit = radius * radius
    # `by_rings` needs room for one more
    degree, source = np.zeros(n, np.int32), np.empty((n, k + 1), np.int32)
    if alpha > 0 and beta > 0 and limit / beta < 1e36 and limit / alpha < 1e8:
        reach = np.int64(np.sqrt(limit / beta * (1 + ROUNDING))) + 1
        if pairs_in_time(t, reach) <= sweep_below * n:
            side = np.int64(np.sqrt(limit / alpha)) + 1
            swept(t, x, y, limit, alpha, beta, k, reach, side, degree, source)
            return degree, source
    _by_pixels(t, x, y, limit, alpha, beta, k, degree, source)
    return degree, source


@njit
def _by_pixels(t, x, y, limit, alpha, beta, k, degree, source):
    """Fill the lists of sources: the pixels near a pixel are found once for all of its events, nearest first."""
    n = t.size
    span = np.float64(t[n - 1] - t[0]) if n else 0.0
    # rounded like a distance, because at exactly the radius a bit decides
    slack = beta * (span * span)
    # without alpha all events are at one place
    here = np.int64(alpha > 0)
    order, first, place, tiles, blocks = by_pixel(x * here, y * here)
    furthest, blur = np.int64(0), np.int64(0)
    if alpha > 0:
        furthest = np.int64(min(np.floor(limit / alpha * (1 + ROUNDING)), np.float64(FAR)))
        blur = np.int64(min(np.floor(slack / alpha * (1 + ROUNDING)), np.float64(FAR)))
    offsets, begins, lengths = offsets_within(min(furthest, np.int64(TABLE * TABLE)))
    flat, steps = flat_map(n, place, tiles, offsets)
    pixels = first.size - 1
    near, apart = np.empty(pixels + 1, np.int32), np.empty(pixels + 1, np.int64)
    marked, used = bit_sets(2, n)
    whole, last, both = np.empty(n + 1, np.int32), np.empty(n + 1, np.int32), np.empty(n + 1, np.int32)
    at = np.empty(n + 1, np.uint64)
    distance, gap = np.empty(k, np.float64), np.empty(k, np.int64)
    for pixel in range(pixels):
        m, total = near_pixels(
            pixel,
            k + 1,
            furthest,
            blur,
            first,
            place,
            tiles,
            blocks,
            flat,
            offsets,
            steps,
            begins,
            lengths,
            near,
            apart,
        )
        sure = True
        if alpha * apart[m - 1] + slack > limit:
            m, total, sure = _within_time(pixel, m, limit, alpha, beta, slack, t, order, first, near, apart)
        if sure and (blur == 0 or total <= k + 1):
            by_rings(
                pixel, m, total, k, t, order, first, near, apart, marked, used, whole, last, both, at, degree, source
            )
        else:
            _one_by_one(
                pixel, m, k, limit, alpha, beta, t, order, first, near, apart, whole, distance, gap, degree, source
            )


@njit
def _within_time(pixel, m, limit, alpha, beta, slack, t, order, first, near, apart):
    """Keep the near pixels of which some event is near in time, too: how many, their events, and whether all are."""
    kept, total, sure = 0, 0, True
    for q in range(m):
        if alpha * apart[q] + slack > limit:
            left = limit - alpha * apart[q]
            if left < 0:
                continue
            if not _any_within(np.sqrt((left + limit * ROUNDING) / beta) + 1, pixel, near[q], t, order, first):
                continue
            sure = False
        near[kept], apart[kept] = near[q], apart[q]
        kept += 1
        total += first[near[q] + 1] - first[near[q]]
    return kept, total, sure


@njit
def _any_within(dt, a, b, t, order, first):
    """Whether some event of pixel `a` and another of pixel `b` are at most `dt` apart in time."""
    i, j = first[a], first[b]
    while i < first[a + 1] and j < first[b + 1]:
        apart = t[order[i]] - t[order[j]]
        if abs(apart) <= dt:
            return True
        if apart < 0:
            i += 1
        else:
            j += 1
    return False


@njit
def _earlier_run(t, order, start, last):
    """First place from `start` on of the events that have the time of the one at `last`."""
    return np.int64(first_at(t, order, np.uint64(start), np.uint64(last), t[order[last]]))


@njit
def _one_by_one(pixel, m, k, limit, alpha, beta, t, order, first, near, apart, place, distance, gap, degree, source):
    """Sources of a pixel's events where distances in space and time add up: pixel by pixel, outward in time."""
    for q in range(m):
        place[q] = first[near[q]]
    for e in range(first[pixel], first[pixel + 1]):
        i = order[e]
        found = source[i]
        have, worst = 0, 0
        for q in range(m):
            start, end = np.int64(first[near[q]]), np.int64(first[near[q] + 1])
            while place[q] < end and order[place[q]] < i:
                place[q] += 1
            base = alpha * apart[q]
            if have == k and base > distance[worst]:
                break
            last, after = np.int64(place[q]) - 1, np.int64(place[q])
            # earlier events by runs of equal times, each from its smallest index on
            before = _earlier_run(t, order, start, last) if last >= start else last
            while last >= start or after < end:
                if after < end and order[after] == i:
                    after += 1
                    continue
                if after == end or (last >= start and t[i] - t[order[before]] <= t[order[after]] - t[i]):
                    j = order[before]
                    before += 1
                    if before > last:
                        last = _earlier_run(t, order, start, last) - 1
                        before = _earlier_run(t, order, start, last) if last >= start else last
                else:
                    j = order[after]
                    after += 1
                dt = abs(t[j] - t[i])
                d = base + beta * (np.float64(dt) * np.float64(dt))
                if d > limit:
                    break
                if have < k:
                    slot = have
                    have += 1
                elif comes_before(d, dt, j, distance[worst], gap[worst], found[worst]):
                    slot = worst
                else:
                    break
                distance[slot], gap[slot], found[slot] = d, dt, j
                if have == k:
                    worst = 0
                    for s in range(1, k):
                        if comes_before(distance[worst], gap[worst], found[worst], distance[s], gap[s], found[s]):
                            worst = s
        ascend(source, np.uint64(i), have)
        degree[i] = have
