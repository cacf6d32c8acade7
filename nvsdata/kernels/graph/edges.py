"""Loops over the edges of a graph."""

from __future__ import annotations

import numpy as np

from nvsdata.kernels import _native
from nvsdata.kernels.graph.neighbors import near_edges

GROUPED, UNGROUPED, NO_SUCH_NODE, NOT_FINITE = 0, 1, 2, 3  # results of `check_edges`


def event_graph(
    t: np.ndarray,
    x: np.ndarray,
    y: np.ndarray,
    p: np.ndarray,
    start: int,
    radius: float,
    alpha: float,
    beta: float,
    k: int,
    reach: tuple[float, ...],
    signed: bool,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return the arrays of a graph: polarity ±1 [N, 1], pos [N, 2], t since `start` [N], edges and pseudo-coordinates.

    `near_edges` describes the edges, and `pseudo_coordinates` the arguments `reach` and `signed`.
    """
    edges = near_edges(t, x, y, radius, alpha, beta, k)
    feature, pos = np.empty((t.size, 1), np.float32), np.empty((t.size, 2), np.float32)
    since = np.empty(t.size, np.int64)
    _native.event_nodes(t, x, y, p, start, feature, pos, since)
    return feature, pos, since, edges, pseudo_coordinates(pos, t, edges, reach, signed)


def pseudo_coordinates(
    pos: np.ndarray, t: np.ndarray, edges: np.ndarray, reach: tuple[float, ...], signed: bool
) -> np.ndarray:
    """Return differences from target to source of every edge, as fractions of `reach`: float32 [E, len(reach)]. O(E).

    Args:
        pos: Positions of nodes in pixels, float32 [N, 2].
        t: Times of nodes in µs, int64 [N].
        edges: Source and target of each edge, int64 [2, E].
        reach: Normalization ranges of x and y in pixels and, if there are three, of t in µs.
        signed: True for 1/2 + d / (2 reach), clipped to 0..1, where d is the difference; False for min(|d| / reach, 1).

    Raises:
        IndexError: An edge has a node that doesn't exist.
    """
    out = np.empty((edges.shape[1], len(reach)), np.float32)
    ends = *reach[:2], reach[2] if len(reach) == 3 else 1.0
    if not _native.pseudo_coordinates(pos, t, edges, *ends, signed, out):
        raise IndexError("edge_index names a node that is not there")
    return out


def check_edges(source: np.ndarray, target: np.ndarray, u: np.ndarray, nodes: int) -> int:
    """Return a code: whether edges are valid, and whether they are grouped by target. O(E)."""
    code: int = _native.check_edges(source, target, u, nodes)
    return code


def with_self_loops(
    source: np.ndarray, target: np.ndarray, u: np.ndarray, nodes: int, origin: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return edges grouped by target, with a self-loop at the beginning of each group. O(E + N).

    The self-loops have the pseudo-coordinates `origin`.

    `source`, `target` int64 [E] are sorted by target, `u` is float [E, D]; the results are int64 [2, E + N] and
    [E + N, D].
    """
    edges = np.empty((2, source.size + nodes), np.int64)
    out = np.empty((source.size + nodes, u.shape[1]), u.dtype)
    _native.with_self_loops(source, target, u, origin, edges, out)
    return edges, out
