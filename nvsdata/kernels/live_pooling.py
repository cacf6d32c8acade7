"""Features of pooled graphs, and of the last one the first fully connected layer, that follow what is below them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from nvsdata.kernels.compiling import njit
from nvsdata.kernels.marks import clear, mark


class Readout(NamedTuple):
    """The first fully connected layer.

    - `weight` float32 [cells * channels, hidden]
    - `shown` float32 [cells, channels]: features that `sum` float64 [hidden] has in it
    - `products` int64 [1]: multiplications so far
    """

    weight: np.ndarray
    shown: np.ndarray
    sum: np.ndarray
    products: np.ndarray


@njit
def pool(cells, out, average, features):
    """Pool the rows below, `out` [nodes, C] before the activation, of the cells in `rescan`. O(their members · C)."""
    best = np.empty(out.shape[1], np.float64)
    for n in range(cells.rescan.count[0]):
        cell = cells.rescan.numbers[n]
        if cells.members[cell]:
            _pooled(cells, cell, out, average, best)
            set_features(features, cell, best)
    clear(cells.rescan)


@njit
def _pooled(cells, cell, out, average, best):
    """The maximum, or mean, of the members' rows after the activation."""
    best[:] = 0.0
    node = cells.head[cell]
    while node >= 0:
        row = node % cells.after.size
        if average:
            for c in range(best.size):
                best[c] += max(out[row, c], np.float32(0))
        else:
            for c in range(best.size):
                best[c] = max(best[c], np.float64(out[row, c]))
        node = cells.after[row]
    if average:
        for c in range(best.size):
            best[c] /= cells.members[cell]


@njit
def set_features(features, node, values):
    """Set the features of a node, and mark it if they changed."""
    row = features.values[node]
    for c in range(values.size):
        if row[c] != np.float32(values[c]):
            if not features.changed.marked[node]:
                features.before[node] = row
                mark(features.changed, node)
            break
    for c in range(values.size):
        row[c] = values[c]


@njit
def activate(rows, out, features):
    """Features for another layer of the same graph, of the rows that were computed."""
    active = np.empty(out.shape[1], np.float32)
    for n in range(rows.count[0]):
        row = rows.numbers[n]
        for c in range(active.size):
            active[c] = max(out[row, c], np.float32(0))
        set_features(features, row, active)


@njit
def read_out(cells, features, readout):
    """Bring the fully connected layer up to date. O(changed features · hidden)."""
    for marks in (cells.moved, features.changed):
        for n in range(marks.count[0]):
            cell = marks.numbers[n]
            if cells.members[cell] > 0:
                show(readout, cell, features.values[cell])
            else:
                show(readout, cell, np.zeros(features.values.shape[1], np.float32))
    clear(features.changed)


@njit
def show(readout, cell, values):
    """Set the features of a cell that the fully connected layer sees."""
    shown = readout.shown[cell]
    for c in range(values.size):
        difference = np.float64(values[c]) - shown[c]
        if difference != 0:
            shown[c] = values[c]
            weight = readout.weight[cell * shown.size + c]
            for o in range(weight.size):
                readout.sum[o] += difference * weight[o]
            readout.products[0] += weight.size
