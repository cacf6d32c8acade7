"""Counts of recent events around each event, by distance and direction."""

from __future__ import annotations

import numpy as np

from nvsdata.kernels.compiling import njit


@njit
def around_events(x, y, queue, dx, dy, weights, count, out):
    """Put the weighted numbers of the events in the queue around each event into `out` float32 [N, bins], of sum 1.

    The queue holds the `queue` latest events up to the event, itself included. `dx`, `dy` [M] are offsets, and
    `weights` float32 [M, bins] what an event there adds; `count` int32 [H + 2 r, W + 2 r], r being the largest
    offset, is scratch, 0. O(N M), and the bins that an offset reaches.
    """
    margin = np.uint64(dx.max())
    offsets, bins = np.uint64(dx.size), np.uint64(weights.shape[1])
    row, column = y.astype(np.int64) + np.int64(margin), x.astype(np.int64) + np.int64(margin)
    # the bins that each offset reaches, one after the other
    begins = np.zeros(dx.size + 1, np.int64)
    for m in range(offsets):
        begins[m + np.uint64(1)] = begins[m] + np.count_nonzero(weights[m])
    which, share = np.empty(begins[-1], np.int64), np.empty(begins[-1], np.float32)
    place = 0
    for m in range(offsets):
        for b in range(bins):
            if weights[m, b]:
                which[place], share[place] = b, weights[m, b]
                place += 1
    for i in range(np.uint64(x.size)):
        count[np.uint64(row[i]), np.uint64(column[i])] += 1
        if np.int64(i) >= queue:
            old = i - np.uint64(queue)
            count[np.uint64(row[old]), np.uint64(column[old])] -= 1
        total = np.float32(0)
        for m in range(offsets):
            near = count[np.uint64(row[i] + dy[m]), np.uint64(column[i] + dx[m])]
            if near:
                for place in range(begins[m], begins[m + np.uint64(1)]):
                    value = near * share[place]
                    out[i, which[place]] += value
                    total += value
        for b in range(bins):
            out[i, b] /= total
