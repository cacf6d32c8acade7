"""Small loops over the edges of a graph."""

from __future__ import annotations

import numpy as np
from numba import njit

from nvsdata.kernels.neighbors import nearest_edges, radius_edges


@njit(cache=True, nogil=True)
def event_graph(t, x, y, p, start, radius, alpha, beta, max_degree, reach):
    """Arrays of the radius graph of events: polarity ±1 [N, 1], pos [N, 2], t from `start`, edges, pseudo-coordinates.

    See `radius_edges` for the edges; `reach` is a pair of numbers.
    """
    return _with_nodes(t, x, y, p, start, radius_edges(t, x, y, radius, alpha, beta, max_degree), reach)


@njit(cache=True, nogil=True)
def nearest_event_graph(t, x, y, p, start, alpha, beta, reach):
    """The same arrays for the graph that joins each event with its nearest; see `nearest_edges`."""
    return _with_nodes(t, x, y, p, start, nearest_edges(t, x, y, alpha, beta), reach)


@njit(cache=True, nogil=True)
def _with_nodes(t, x, y, p, start, edges, reach):
    n = t.size
    feature = np.empty((n, 1), np.float32)
    pos = np.empty((n, 2), np.float32)
    for i in range(n):
        feature[i, 0] = 2 * np.int32(p[i]) - 1
        pos[i, 0], pos[i, 1] = x[i], y[i]
    wide, high = np.float32(reach[0]), np.float32(reach[1])
    return feature, pos, t - start, edges, pseudo_coordinates(pos, edges, (wide, high))


@njit(cache=True, nogil=True)
def pseudo_coordinates(pos, edges, reach):
    """min(|dx| / reach[0], 1) and the same along y for every edge: float32 [E, 2]. O(E)."""
    out = np.empty((edges.shape[1], 2), np.float32)
    for e in range(edges.shape[1]):
        i = edges[0, e]
        j = edges[1, e]
        if not (0 <= i < len(pos) and 0 <= j < len(pos)):
            raise IndexError("edge_index names a node that is not there")
        out[e, 0] = min(abs(pos[i, 0] - pos[j, 0]) / reach[0], np.float32(1))
        out[e, 1] = min(abs(pos[i, 1] - pos[j, 1]) / reach[1], np.float32(1))
    return out


GROUPED, UNGROUPED, NO_SUCH_NODE, NOT_FINITE = 0, 1, 2, 3


@njit(cache=True, nogil=True)
def check_edges(source, target, u, nodes):
    """Whether edges are valid, and whether they are grouped by target: one of the codes above. O(E)."""
    code = GROUPED
    last = 0
    for e in range(source.size):
        if not (0 <= source[e] < nodes and 0 <= target[e] < nodes):
            return NO_SUCH_NODE
        if not (np.isfinite(u[e, 0]) and np.isfinite(u[e, 1])):
            return NOT_FINITE
        if target[e] < last:
            code = UNGROUPED
        last = target[e]
    return code


@njit(cache=True, nogil=True)
def with_self_loops(source, target, u, nodes):
    """Edges grouped by target, with a self-loop of pseudo-coordinates 0 in front of each group. O(E + N).

    `source`, `target` int64 [E] sorted by target, `u` [E, 2]; returns int64 [2, E + N] and [E + N, 2].
    """
    edges = np.empty((2, source.size + nodes), np.int64)
    out = np.zeros((source.size + nodes, 2), u.dtype)
    e = 0
    at = 0
    for node in range(nodes):
        edges[0, at] = edges[1, at] = node
        at += 1
        while e < source.size and target[e] == node:
            edges[0, at], edges[1, at] = source[e], node
            out[at, 0], out[at, 1] = u[e, 0], u[e, 1]
            e += 1
            at += 1
    return edges, out
