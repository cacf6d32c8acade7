"""Clusters of nodes: the coarse graph, and features pooled over its clusters.

`cluster` int64 [N] is the cluster of each node, 0 <= cluster < M. A cluster that doesn't exist raises an IndexError,
and sizes that don't agree raise a ValueError.
"""

from __future__ import annotations

import numpy as np

from nvsdata.kernels import _native


def clusters(
    pos: np.ndarray, t: np.ndarray, ptr: np.ndarray, width: int, height: int, columns: int, rows: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return the cluster of every node, and positions and times of the clusters. O(N + B · columns · rows).

    A cluster is a cell of a grid. Nodes outside the grid belong to its border cells, and nodes at NaN to cell 0.
    Clusters are numbered by graph, row, column.

    Args:
        pos: Positions of nodes in pixels, float [N, 2].
        t: Times of nodes in µs, int64 [N].
        ptr: First node of each graph, int64 [B + 1]; graph b has nodes ptr[b] to ptr[b + 1] - 1.
        width: Width of a cluster in pixels.
        height: Height of a cluster in pixels.
        columns: Number of clusters in a row of the grid.
        rows: Number of rows of the grid.

    Returns:
        `cluster` int64 [N]; the clusters' `position` float32 [M, 2] (floor of the mean; thesis, eq. 4.8), `time`
        int64 [M] (also the floor of the mean) and `graph` int64 [M]; and `new_ptr` int64 [B + 1].
    """
    nodes, graphs = t.size, ptr.size - 1
    if pos.shape != (nodes, 2) or graphs < 0 or min(width, height, columns, rows) < 1 or columns * rows >= 2**31:
        raise ValueError(f"no clusters of positions {pos.shape}, {nodes} times, {columns} x {rows} cells")
    most = min(nodes, graphs * columns * rows)
    cluster, new_ptr = np.empty(nodes, np.int64), np.empty(graphs + 1, np.int64)
    position, time, graph = np.empty((most, 2), np.float32), np.empty(most, np.int64), np.empty(most, np.int64)
    m = _native.clusters(pos, t, ptr, width, height, columns, rows, cluster, position, time, graph, new_ptr)
    return cluster, position[:m], time[:m], graph[:m], new_ptr


def merged_edges(source: np.ndarray, target: np.ndarray, cluster: np.ndarray, count: int) -> np.ndarray:
    """Return the edges between `count` clusters whose nodes have edges: each edge once, without loops.

    `source`, `target` int64 [E] are sorted by target. The result is int64 [2, E'] sorted by (target, source).
    O(E + E' log degree).
    """
    edges = np.empty((2, source.size), np.int64)
    return edges[:, : _native.merged_edges(source, target, cluster, count, edges)]


def max_rows(features: np.ndarray, cluster: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the maximum of each channel over each cluster, and the first node that has it. O(N · C).

    NaN counts as larger than any number, as in torch. The results are float [M, C] and int32 [M, C]; a cluster without
    nodes has 0 and -1.
    """
    shape = count, features.shape[1]
    best, where = np.empty(shape, features.dtype), np.empty(shape, np.int32)
    _native.max_rows(features, cluster, best, where)
    return best, where


def max_rows_back(gradient: np.ndarray, where: np.ndarray, nodes: int) -> np.ndarray:
    """Return the gradient of `max_rows`: the gradient of a cluster goes to the node that has the maximum."""
    out = np.zeros((nodes, gradient.shape[1]), gradient.dtype)
    _native.max_rows_back(gradient, where, out)
    return out


def mean_rows(features: np.ndarray, cluster: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the mean of each channel over each cluster. O(N · C + M · C).

    The results are the means, float [M, C], and the number of nodes of each cluster, [M] in the type of the features.
    """
    mean, members = np.empty((count, features.shape[1]), features.dtype), np.zeros(count, features.dtype)
    _native.mean_rows(features, cluster, mean, members)
    return mean, members
