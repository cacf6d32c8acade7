"""B-spline aggregation: each edge adds its source's features, times weights, to the kernel cells of its target.

Kernels have degree 1 and `size` cells along each of D axes. Cell (i, j, ...) has the number i + size j + .... In all
functions `source` and `target` are int64 [E], grouped by target. `u` is float32 or float64 [E, D]; values outside [0,
1] count as the nearer end. Other floats have the same type. An edge has nonzero weights in up to 2^D cells, which are
divided by the number of edges of its target.

An index of a node or row that doesn't exist raises an IndexError, and sizes that don't agree raise a ValueError.
"""

from __future__ import annotations

import numpy as np

from nvsdata.kernels import _native

MOST = 2**31 - 1  # largest number of rows and entries, which are counted by int32


def dense_sums(source: np.ndarray, target: np.ndarray, u: np.ndarray, size: int, features: np.ndarray) -> np.ndarray:
    """Return the weighted sums of `features` [N, C] in every kernel cell of every node: [N size^D, C]. O(2^D E C)."""
    nodes, channels = features.shape
    cells = _cells(u, size, nodes)
    sums = np.zeros((nodes * cells, channels), features.dtype)
    _native.dense_sums(source, target, u, size, features, sums)
    return sums


def dense_gradient(
    source: np.ndarray, target: np.ndarray, u: np.ndarray, size: int, gradient: np.ndarray, nodes: int
) -> np.ndarray:
    """Return the gradient of `dense_sums` with respect to `features`, [N, C], from that of its result. O(2^D E C)."""
    cells = _cells(u, size, nodes)
    if len(gradient) != nodes * cells:
        raise ValueError(f"the gradient has {len(gradient)} rows, not those of {nodes} nodes with {cells} cells each")
    out = np.zeros((nodes, gradient.shape[1]), gradient.dtype)
    _native.dense_gradient(source, target, u, size, gradient, out)
    return out


def spline_plan(
    source: np.ndarray, target: np.ndarray, u: np.ndarray, size: int, nodes: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return the rows of a graph's aggregation, sorted by kernel cell, and the entries that are added to them.

    A row is a pair of node and cell with at least one edge. An entry adds the features of a source, times a weight, to
    a row. O(2^D E + size^D + rows).

    Returns:
        First row of each cell, int64 [size^D + 1]; node of each row, int64 [R]; and for each entry its row int32,
        source int32 and weight (in the type of u).
    """
    cells = _cells(u, size, nodes)
    most = source.size << u.shape[1] if size > 1 else source.size
    if max(most, nodes) > MOST:
        raise ValueError(f"a graph of {nodes} nodes and {source.size} edges is too large")
    cell_start, row_node = np.empty(cells + 1, np.int64), np.empty(most, np.int64)
    (row, of), share = np.empty((2, most), np.int32), np.empty(most, u.dtype)
    rows, entries = _native.spline_plan(source, target, u, size, nodes, cell_start, row_node, row, of, share)
    return cell_start, row_node[:rows], row[:entries], of[:entries], share[:entries]


def add_shares(out: np.ndarray, into: np.ndarray, features: np.ndarray, of: np.ndarray, share: np.ndarray) -> None:
    """Add share[n] * features[of[n]] to out[into[n]] for every n; `into` and `of` int32. O(n · C)."""
    _native.add_shares(out, into, features, of, share)


def add_rows(out: np.ndarray, into: np.ndarray, rows: np.ndarray) -> None:
    """Add rows[n] to out[into[n]] for every n; `into` int64. O(n · C)."""
    _native.add_rows(out, into, rows)


def _cells(u: np.ndarray, size: int, nodes: int) -> int:
    """Return the number of a kernel's cells."""
    cells: int = size ** u.shape[1]
    if not 1 <= cells <= MOST or nodes < 0:
        raise ValueError(f"a kernel can't have {cells} cells, or a graph {nodes} nodes")
    return cells
