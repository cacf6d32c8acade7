"""Small loops over the edges of a graph."""

from __future__ import annotations

import numpy as np

from nvsdata.kernels.compiling import njit
from nvsdata.kernels.neighbors import near_sources


@njit
def event_graph(t, x, y, p, start, radius, alpha, beta, k, reach, signed):
    """Arrays of a graph of events: polarity ±1 [N, 1], pos [N, 2], t from `start`, edges, pseudo-coordinates.

    See `near_sources` for the edges, and `pseudo_coordinates` for `reach` and `signed`.
    """
    n = t.size
    feature = np.empty((n, 1), np.float32)
    pos = np.empty((n, 2), np.float32)
    for i in range(n):
        feature[i, 0] = 2 * np.int32(p[i]) - 1
        pos[i, 0], pos[i, 1] = x[i], y[i]
    degree, source = near_sources(t, x, y, radius, alpha, beta, k)
    edges, u = _edges(degree, source, pos, t, reach, signed)
    return feature, pos, t - start, edges, u


@njit
def _edges(degree, source, pos, t, reach, signed):
    """Edges from lists of sources, and their pseudo-coordinates. O(N + E)."""
    axes, count = len(reach), degree.sum()
    edges, out = np.empty((2, count), np.int64), np.empty((count, axes), np.float32)
    wide, high, long = np.float32(reach[0]), np.float32(reach[1]), np.float32(reach[axes - 1])
    e = np.uint64(0)
    for i in range(np.uint64(degree.size)):
        for n in range(np.uint64(degree[i])):
            j = np.uint64(source[i, n])
            edges[0, e], edges[1, e] = j, i
            _place(out, e, pos, t, j, i, wide, high, long, signed)
            e += np.uint64(1)
    return edges, out


@njit
def pseudo_coordinates(pos, t, edges, reach, signed):
    """Differences from target to source of every edge, as shares of `reach`: float32 [E, len(reach)]. O(E).

    `reach` is a tuple of floats, for x, y and, if there are three, t. The result is min(|d| / reach, 1), or if
    `signed` 1/2 + d / (2 reach) clipped to 0..1.
    """
    axes = len(reach)
    out = np.empty((edges.shape[1], axes), np.float32)
    nodes = len(pos)
    wide, high, long = np.float32(reach[0]), np.float32(reach[1]), np.float32(reach[axes - 1])
    for e in range(np.uint64(edges.shape[1])):
        if not (0 <= edges[0, e] < nodes and 0 <= edges[1, e] < nodes):
            raise IndexError("edge_index names a node that is not there")
        j, i = np.uint64(edges[0, e]), np.uint64(edges[1, e])
        _place(out, e, pos, t, j, i, wide, high, long, signed)
    return out


@njit(inline="always")
def _place(out, e, pos, t, j, i, wide, high, long, signed):
    """Pseudo-coordinates of the edge `e` from `j` to `i`."""
    out[e, 0] = _share((pos[j, 0] - pos[i, 0]) / wide, signed)
    out[e, 1] = _share((pos[j, 1] - pos[i, 1]) / high, signed)
    if out.shape[1] == 3:
        out[e, 2] = _share(np.float32(t[j] - t[i]) / long, signed)


@njit(inline="always")
def _share(d, signed):
    if signed:
        return min(max(d * np.float32(0.5) + np.float32(0.5), np.float32(0)), np.float32(1))
    return min(abs(d), np.float32(1))


GROUPED, UNGROUPED, NO_SUCH_NODE, NOT_FINITE = 0, 1, 2, 3


@njit
def check_edges(source, target, u, nodes):
    """Whether edges are valid, and whether they are grouped by target: one of the codes above. O(E)."""
    code = GROUPED
    last = 0
    for e in range(source.size):
        if not (0 <= source[e] < nodes and 0 <= target[e] < nodes):
            return NO_SUCH_NODE
        for axis in range(u.shape[1]):
            if not np.isfinite(u[e, axis]):
                return NOT_FINITE
        if target[e] < last:
            code = UNGROUPED
        last = target[e]
    return code


@njit
def with_self_loops(source, target, u, nodes, origin):
    """Edges grouped by target, with a self-loop of pseudo-coordinates `origin` in front of each group. O(E + N).

    `source`, `target` int64 [E] sorted by target, `u` [E, D]; returns int64 [2, E + N] and [E + N, D].
    """
    edges = np.empty((2, source.size + nodes), np.int64)
    out = np.full((source.size + nodes, u.shape[1]), origin, u.dtype)
    e = 0
    at = 0
    for node in range(nodes):
        edges[0, at] = edges[1, at] = node
        at += 1
        while e < source.size and target[e] == node:
            edges[0, at], edges[1, at] = source[e], node
            for axis in range(u.shape[1]):
                out[at, axis] = u[e, axis]
            e += 1
            at += 1
    return edges, out
