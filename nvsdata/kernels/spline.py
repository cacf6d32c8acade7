"""Sparse B-spline aggregation: only the (node, kernel cell) pairs that occur are visited."""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True, nogil=True, inline="always")
def _corner(u, size):
    """Lower kernel index, and the share of the upper one, at position u in [0, 1] of an axis."""
    if size == 1:
        return 0, u * 0
    v = min(max(u, u * 0), u * 0 + 1) * (size - 1)
    lower = min(int(v), size - 2)
    return lower, v - lower


@njit(cache=True, nogil=True)
def spline_shares(source, target, u, size, nodes):
    """Entries of the dense aggregation, whose row for a node and a cell is node * size² + cell.

    Arguments and entries are as in `spline_plan`. O(4 E).
    """
    degree = np.zeros(nodes, np.int32)
    for e in range(source.size):
        degree[target[e]] += 1
    corners = 1 if size == 1 else 2
    most = source.size * corners * corners
    entry_row = np.empty(most, np.int32)
    entry_source = np.empty(most, np.int32)
    entry_share = np.empty(most, u.dtype)
    n = 0
    for e in range(source.size):
        i, fx = _corner(u[e, 0], size)
        j, fy = _corner(u[e, 1], size)
        first = target[e] * size * size + i + size * j
        for b in range(corners):
            for a in range(corners):
                share = (fx if a else 1 - fx) * (fy if b else 1 - fy)
                if share > 0:
                    entry_row[n] = first + a + size * b
                    entry_source[n] = source[e]
                    entry_share[n] = share / degree[target[e]]
                    n += 1
    return entry_row[:n], entry_source[:n], entry_share[:n]


@njit(cache=True, nogil=True)
def spline_plan(source, target, u, size, nodes):
    """The rows of a graph's aggregation, sorted by kernel cell.

    `source`, `target` int64 [E] grouped by target, `u` float [E, 2] in [0, 1], `size` the kernel
    size. A row is a (node, cell) pair that at least one edge touches; an entry adds a share of a
    source's features to a row. O(4 E + size² + rows).

    Returns `cell_start` int64 [size² + 1], `row_node` int64 [R], and for each entry `entry_row`
    int32, `entry_source` int32 and `entry_share` (type of u), the mean over the neighbors
    included.
    """
    edges = source.size
    cells = size * size
    stamp = np.full(cells, -1, np.int64)
    cell_start = np.zeros(cells + 1, np.int64)
    entries = 0
    for e in range(edges):
        i, fx = _corner(u[e, 0], size)
        j, fy = _corner(u[e, 1], size)
        for b in range(2):
            for a in range(2):
                if (fx if a else 1 - fx) * (fy if b else 1 - fy) > 0:
                    cell = i + a + size * (j + b)
                    entries += 1
                    if stamp[cell] != target[e]:
                        stamp[cell] = target[e]
                        cell_start[cell + 1] += 1
    for cell in range(cells):
        cell_start[cell + 1] += cell_start[cell]
    fill = cell_start[:-1].copy()
    row_node = np.empty(cell_start[-1], np.int64)
    entry_row = np.empty(entries, np.int32)
    entry_source = np.empty(entries, np.int32)
    entry_share = np.empty(entries, u.dtype)
    stamp[:] = -1
    slot = np.empty(cells, np.int64)
    n = 0
    start = 0
    while start < edges:
        node = target[start]
        stop = start
        while stop < edges and target[stop] == node:
            stop += 1
        for e in range(start, stop):
            i, fx = _corner(u[e, 0], size)
            j, fy = _corner(u[e, 1], size)
            for b in range(2):
                for a in range(2):
                    share = (fx if a else 1 - fx) * (fy if b else 1 - fy)
                    if share > 0:
                        cell = i + a + size * (j + b)
                        if stamp[cell] != node:
                            stamp[cell] = node
                            slot[cell] = fill[cell]
                            row_node[fill[cell]] = node
                            fill[cell] += 1
                        entry_row[n] = slot[cell]
                        entry_source[n] = source[e]
                        entry_share[n] = share / (stop - start)
                        n += 1
        start = stop
    return cell_start, row_node, entry_row, entry_source, entry_share


@njit(cache=True, nogil=True)
def add_shares(out, into, features, of, share):
    """out[into[n]] += share[n] * features[of[n]] for every n. O(n · C)."""
    channels = features.shape[1]
    for n in range(into.size):
        a = into[n]
        b = of[n]
        w = share[n]
        for c in range(channels):
            out[a, c] += w * features[b, c]


@njit(cache=True, nogil=True)
def add_rows(out, into, rows):
    """out[into[n]] += rows[n] for every n. O(n · C)."""
    channels = rows.shape[1]
    for n in range(into.size):
        a = into[n]
        for c in range(channels):
            out[a, c] += rows[n, c]
