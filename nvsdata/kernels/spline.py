"""Sparse B-spline aggregation: only the (node, kernel cell) pairs that occur are visited."""

from __future__ import annotations

import numpy as np

from nvsdata.kernels.compiling import njit

_ONE = np.uint64(1)


@njit
def spline_entries(source, target, u, size, nodes):
    """What each edge adds to which kernel cell of its target, for B-splines of degree 1 in any number of dimensions.

    `source`, `target` int64 [E] grouped by target, `u` float [E, D] in [0, 1], `size` cells along each axis; cell
    (i, j, ...) has the number i + size j + .... Returns for each of up to 2^D entries per edge, those without a share
    left out: `node` int32, `cell` int32, `from` int32 and `share` (type of u), divided by the number of the node's
    edges. O(2^D E).
    """
    dim = np.uint64(u.shape[1])
    degree = np.zeros(nodes, np.int32)
    for e in range(source.size):
        degree[target[e]] += 1
    corners = 1 << u.shape[1] if size > 1 else 1
    most = source.size * corners
    entry_node, entry_cell = np.empty(most, np.int32), np.empty(most, np.int32)
    entry_from, entry_share = np.empty(most, np.int32), np.empty(most, u.dtype)
    n = np.uint64(0)
    for e in range(np.uint64(source.size)):
        # the entries of an edge: they double with each axis
        first = n
        entry_cell[n], entry_share[n] = 0, u[e, np.uint64(0)] * 0 + 1
        n += _ONE
        stride = 1
        if size > 1:
            for axis in range(dim):
                v = min(max(u[e, axis], u[e, axis] * 0), u[e, axis] * 0 + 1) * (size - 1)
                lower = min(int(v), size - 2)
                upper = v - lower
                last = n
                for k in range(first, last):
                    cell, share = entry_cell[k] + lower * stride, entry_share[k]
                    entry_cell[k], entry_share[k] = cell, share * (1 - upper)
                    # no branch: written in any case, but counted only if there is a share
                    entry_cell[n], entry_share[n] = cell + stride, share * upper
                    n += np.uint64(upper > 0)
                if upper == 1:
                    # nothing is left for the lower cells
                    for k in range(first, last):
                        entry_cell[k], entry_share[k] = entry_cell[k + last - first], entry_share[k + last - first]
                    n = last
                stride *= size
        share = degree[target[e]]
        for k in range(first, n):
            entry_node[k], entry_from[k] = target[e], source[e]
            entry_share[k] /= share
    return entry_node[:n], entry_cell[:n], entry_from[:n], entry_share[:n]


@njit
def spline_shares(source, target, u, size, nodes):
    """Entries of the dense aggregation: row, source and share of each.

    The row of a node and a cell is node * size^D + cell. See `spline_entries`.
    """
    node, cell, of, share = spline_entries(source, target, u, size, nodes)
    cells = size ** u.shape[1]
    for n in range(node.size):
        cell[n] += node[n] * cells
    return cell, of, share


@njit
def spline_plan(source, target, u, size, nodes):
    """The rows of a graph's aggregation, sorted by kernel cell.

    A row is a (node, cell) pair that at least one edge touches; an entry adds a share of a source's features to a
    row. Arguments are those of `spline_entries`. O(2^D E + size^D + rows).

    Returns `cell_start` int64 [size^D + 1], `row_node` int64 [R], and for each entry its row int32, source int32 and
    share (type of u), the mean over the neighbors included.
    """
    node, cell, of, share = spline_entries(source, target, u, size, nodes)
    cells = size ** u.shape[1]
    stamp = np.full(cells, -1, np.int64)
    cell_start = np.zeros(cells + 1, np.int64)
    for n in range(np.uint64(node.size)):
        at = np.uint64(cell[n])
        if stamp[at] != node[n]:
            stamp[at] = node[n]
            cell_start[at + _ONE] += 1
    for c in range(cells):
        cell_start[c + 1] += cell_start[c]
    fill = cell_start[:-1].copy()
    row_node = np.empty(cell_start[-1], np.int64)
    row = np.empty(node.size, np.int32)
    stamp[:] = -1
    for n in range(np.uint64(node.size)):
        at = np.uint64(cell[n])
        if stamp[at] != node[n]:
            stamp[at] = node[n]
            row_node[np.uint64(fill[at])] = node[n]
            fill[at] += 1
        row[n] = fill[at] - 1
    return cell_start, row_node, row, of, share


@njit
def add_shares(out, into, features, of, share):
    """out[into[n]] += share[n] * features[of[n]] for every n. O(n · C)."""
    channels = features.shape[1]
    for n in range(into.size):
        a = into[n]
        b = of[n]
        w = share[n]
        for c in range(channels):
            out[a, c] += w * features[b, c]


@njit
def add_rows(out, into, rows):
    """out[into[n]] += rows[n] for every n. O(n · C)."""
    channels = rows.shape[1]
    for n in range(into.size):
        a = into[n]
        for c in range(channels):
            out[a, c] += rows[n, c]
