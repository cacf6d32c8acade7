"""Clusters of nodes: the coarse graph, and features pooled over its clusters."""

from __future__ import annotations

import numpy as np

from nvsdata.kernels.compiling import njit


@njit
def clusters(pos, t, ptr, width, height, columns, rows):
    """Cluster of every node, and positions and times of the clusters. O(N + B · columns · rows).

    `pos` float [N, 2], `t` int64 [N]; graph b owns nodes ptr[b]..ptr[b + 1]; a cluster is a cell of
    `width` x `height` pixels; nodes outside the grid belong to its border cells, nodes at NaN to cell 0.
    Clusters are numbered by graph, row, column.

    Returns `cluster` int64 [N]; the clusters' `position` float32 [M, 2] (floor of the mean, eq. 4.8),
    `time` int64 [M] (likewise) and `graph` int64 [M]; and `new_ptr` int64 [B + 1].
    """
    graphs = ptr.size - 1
    cluster = np.empty(len(pos), np.int64)
    slot = np.empty(columns * rows, np.int64)
    most = min(len(pos), graphs * columns * rows)
    position = np.empty((most, 2), np.float32)
    graph = np.empty(most, np.int64)
    new_ptr = np.zeros(graphs + 1, np.int64)
    # float64: sums of whole pixels must be exact for the floor to be
    sums = np.zeros((most, 2), np.float64)
    # times are summed from that of the first node on: a sum of dates in µs may be beyond int64
    first, time = np.empty(most, np.int64), np.zeros(most, np.int64)
    members = np.zeros(most, np.int64)
    m = 0
    for b in range(graphs):
        slot[:] = -1
        for i in range(ptr[b], ptr[b + 1]):
            # clipped as floats, because NaN and infinities aren't integers; in this order NaN becomes 0
            column = int(min(max(0.0, pos[i, 0] / width), columns - 1.0))
            row = int(min(max(0.0, pos[i, 1] / height), rows - 1.0))
            cluster[i] = row * columns + column
            slot[cluster[i]] = 0
        for cell in range(slot.size):
            if slot[cell] == 0:
                slot[cell] = m
                graph[m] = b
                m += 1
        for i in range(ptr[b], ptr[b + 1]):
            c = slot[cluster[i]]
            cluster[i] = c
            sums[c, 0] += pos[i, 0]
            sums[c, 1] += pos[i, 1]
            if members[c] == 0:
                first[c] = t[i]
            time[c] += t[i] - first[c]
            members[c] += 1
        new_ptr[b + 1] = m
    for c in range(m):
        position[c, 0] = np.floor(sums[c, 0] / members[c])
        position[c, 1] = np.floor(sums[c, 1] / members[c])
        time[c] = first[c] + time[c] // members[c]
    return cluster, position[:m], time[:m], graph[:m], new_ptr


@njit
def merged_edges(source, target, cluster, count):
    """Edges between clusters that any edge of their nodes joins: each once, no loops.

    `source`, `target` int64 [E] in any order, `cluster` int64 [N], `count` clusters. Returns
    int64 [2, E'] sorted by (target, source). O(E + E' log degree).
    """
    start = np.zeros(count + 1, np.int64)
    for e in range(target.size):
        start[cluster[target[e]] + 1] += 1
    for c in range(count):
        start[c + 1] += start[c]
    fill = start[:-1].copy()
    arriving = np.empty(source.size, np.int64)
    for e in range(source.size):
        c = cluster[target[e]]
        arriving[fill[c]] = cluster[source[e]]
        fill[c] += 1
    mark = np.full(count, -1, np.int64)
    kept = 0
    edges = np.empty((2, source.size), np.int64)
    for c in range(count):
        mark[c] = c
        first = kept
        for k in range(start[c], start[c + 1]):
            s = arriving[k]
            if mark[s] != c:
                mark[s] = c
                edges[0, kept] = s
                edges[1, kept] = c
                kept += 1
        edges[0, first:kept].sort()
    return edges[:, :kept]


@njit
def max_rows(features, cluster, count):
    """Maximum of each channel over each cluster, and the first node that has it. O(N · C).

    NaN counts as more than any number, as in torch. Returns float [M, C] and int32 [M, C].
    """
    channels = features.shape[1]
    best = np.empty((count, channels), features.dtype)
    where = np.full((count, channels), -1, np.int32)
    seen = np.zeros(count, np.bool_)
    for i in range(cluster.size):
        m = cluster[i]
        if not seen[m]:
            seen[m] = True
            for c in range(channels):
                best[m, c] = features[i, c]
                where[m, c] = i
            continue
        for c in range(channels):
            # true of NaN, unless there was one before
            if not features[i, c] <= best[m, c] and best[m, c] == best[m, c]:
                best[m, c] = features[i, c]
                where[m, c] = i
    return best, where


@njit
def mean_rows(features, cluster, count):
    """Mean of each channel over each cluster. O(N · C + M · C).

    Returns float [M, C], and how many nodes each cluster has, in the type of the features [M].
    """
    channels = features.shape[1]
    # sums in float64: they may be beyond float32 where the mean isn't
    sums = np.zeros((count, channels))
    mean = np.empty((count, channels), features.dtype)
    members = np.zeros(count, features.dtype)
    for i in range(cluster.size):
        m = cluster[i]
        members[m] += 1
        for c in range(channels):
            sums[m, c] += features[i, c]
    for m in range(count):
        for c in range(channels):
            mean[m, c] = sums[m, c] / members[m]
    return mean, members


@njit
def max_rows_back(gradient, where, nodes):
    """Gradient of `max_rows`: what arrives at a cluster goes to the node that gave the maximum."""
    channels = gradient.shape[1]
    out = np.zeros((nodes, channels), gradient.dtype)
    for m in range(where.shape[0]):
        for c in range(channels):
            out[where[m, c], c] += gradient[m, c]
    return out
