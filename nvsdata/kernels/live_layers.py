"""B-spline convolutions of graphs that change: only rows whose inputs changed are computed, from what changed in them.

The sum over a node's edges is kept in float64, so that what was added can be taken away: a target with few changed
edges adds the difference of each, one with many is summed anew. Zeros, of which ReLU makes many, aren't multiplied.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from nvsdata.kernels.compiling import njit
from nvsdata.kernels.live_clusters import neighbor, offset_of
from nvsdata.kernels.live_neighbors import row_of
from nvsdata.kernels.marks import Marks, clear, mark


class Features(NamedTuple):
    """Features of nodes: `values` float32 [nodes, C], and what they were `before` this step where they `changed`."""

    values: np.ndarray
    before: np.ndarray
    changed: Marks


class Layer(NamedTuple):
    """A convolution with folded normalization, and the rows of its graph.

    - `weight` float32 [kernels, in, out], `root` float32 [in, out], `bias` float32 [out]
    - `size`: cells of the kernel along an axis; `loops`: 1 if a node is its own neighbor; `signed`: of the
      pseudo-coordinates
    - `reach` float32 [axes]: differences that end an axis
    - `sum`, `own` float64 [nodes, out]: over the edges, and of the node itself; `out` float32 [nodes, out]
    - `dirty`: nodes to compute, and afterwards those that were
    - `share` float64 [kernels, in], `used`: what one target sums up, and in which cells
    - `products` int64 [1]: multiplications so far
    """

    weight: np.ndarray
    root: np.ndarray
    bias: np.ndarray
    size: int
    loops: int
    signed: bool
    reach: np.ndarray
    sum: np.ndarray
    own: np.ndarray
    out: np.ndarray
    dirty: Marks
    share: np.ndarray
    used: Marks
    products: np.ndarray


@njit
def convolve_events(window, layer, features):
    """Compute the dirty rows of events, each anew: they have few features. Those left are `dirty` afterwards."""
    left = 0
    for n in range(layer.dirty.count[0]):
        row = layer.dirty.numbers[n]
        layer.dirty.marked[row] = False
        first = window.ends[0]
        if first + ((row - first) & (window.t.size - 1)) >= window.ends[1]:
            continue
        layer.dirty.numbers[left] = row
        left += 1
        degree = window.degree[row]
        for edge in range(degree):
            source = row_of(window, window.source[row, edge])
            dx, dy = window.x[source] - window.x[row], window.y[source] - window.y[row]
            _add(layer, features[source], dx, dy, window.t[source] - window.t[row], 1.0)
        layer.sum[row], layer.own[row] = 0.0, layer.bias
        _add_self(layer, row, features[row], 1.0)
        _multiply(layer, layer.sum[row])
        _finish(layer, row, degree + layer.loops)
    layer.dirty.count[0] = left


@njit
def convolve_cells(cells, layer, features):
    """Compute the rows of a pooled graph whose inputs changed; those computed are `dirty` afterwards."""
    offsets = cells.edge.shape[1]
    for marks in (cells.moved, features.changed):
        for n in range(marks.count[0]):
            cell = marks.numbers[n]
            mark(layer.dirty, cell)
            for offset in range(offsets):
                other = neighbor(cells, cell, offset)
                if other >= 0 and cells.edge[other, offset_of(cells, other, cell)]:
                    mark(layer.dirty, other)
    for n in range(cells.turned.count[0]):
        mark(layer.dirty, cells.turned.numbers[n] // offsets)
    left = 0
    for n in range(layer.dirty.count[0]):
        cell = layer.dirty.numbers[n]
        layer.dirty.marked[cell] = False
        if cells.members[cell]:
            _convolve_cell(cells, layer, features, cell)
            layer.dirty.numbers[left] = cell
            left += 1
    layer.dirty.count[0] = left
    clear(features.changed)


@njit
def _convolve_cell(cells, layer, features, cell):
    """Compute a row, anew or by what is different in it."""
    offsets = cells.edge.shape[1]
    degree, different = layer.loops, np.int64(features.changed.marked[cell])
    for offset in range(offsets):
        now = cells.edge[cell, offset]
        degree += now
        if cells.turned.marked[cell * offsets + offset]:
            different += 1
        elif now:
            source = neighbor(cells, cell, offset)
            different += 2 * (cells.moved.marked[source] or features.changed.marked[source])
    anew = cells.moved.marked[cell] or different > degree
    for offset in range(offsets):
        now, turned = cells.edge[cell, offset], cells.turned.marked[cell * offsets + offset]
        if not (now or turned):
            continue
        source = neighbor(cells, cell, offset)
        if anew and now:
            _add_edge(layer, features.values[source], cells.place, source, cells.place, cell, 1.0)
        elif not anew and (turned or cells.moved.marked[source] or features.changed.marked[source]):
            if now:
                _add_edge(layer, features.values[source], cells.place, source, cells.place, cell, 1.0)
            if now != turned:
                old = features.before if features.changed.marked[source] else features.values
                places = cells.was if cells.moved.marked[source] else cells.place
                _add_edge(layer, old[source], places, source, cells.place, cell, -1.0)
    if anew:
        layer.sum[cell], layer.own[cell] = 0.0, layer.bias
    if anew or features.changed.marked[cell]:
        _add_self(layer, cell, features.values[cell], 1.0)
    if not anew and features.changed.marked[cell]:
        _add_self(layer, cell, features.before[cell], -1.0)
    _multiply(layer, layer.sum[cell])
    _finish(layer, cell, degree)


@njit
def _add_self(layer, cell, features, way):
    if layer.loops:
        _add(layer, features, 0, 0, 0, way)
    _add_own(layer, cell, features, way)


@njit
def _add_edge(layer, features, sources, source, targets, target, way):
    dx, dy = sources[source, 0] - targets[target, 0], sources[source, 1] - targets[target, 1]
    _add(layer, features, dx, dy, sources[source, 2] - targets[target, 2], way)


@njit
def _add(layer, features, dx, dy, dt, way):
    """Add a source's features to the kernel cells that an edge touches, by their B-splines of degree 1."""
    size, axes = layer.size, layer.reach.size
    corners, cell, shares = 1, np.zeros(8, np.int64), np.full(8, way)
    stride = 1
    for axis in range(axes if size > 1 else 0):
        d = np.float32(dx if axis == 0 else dy if axis == 1 else dt) / layer.reach[axis]
        u = _coordinate(d, layer.signed)
        v = u * (size - 1)
        lower = min(int(v), size - 2)
        upper = np.float64(v - lower)
        for n in range(corners):
            cell[corners + n], shares[corners + n] = cell[n] + (lower + 1) * stride, shares[n] * upper
            cell[n], shares[n] = cell[n] + lower * stride, shares[n] * (1 - upper)
        corners *= 2
        stride *= size
    for n in range(corners):
        if shares[n] != 0:
            mark(layer.used, cell[n])
            row = layer.share[cell[n]]
            for c in range(features.size):
                row[c] += shares[n] * features[c]


@njit(inline="always")
def _coordinate(d, signed):
    """A pseudo-coordinate as `kernels.graph` has it, in float32."""
    if signed:
        return min(max(d * np.float32(0.5) + np.float32(0.5), np.float32(0)), np.float32(1))
    return min(abs(d), np.float32(1))


@njit
def _multiply(layer, out):
    """Add what a target has summed up, times the weights, and forget it."""
    channels = out.size
    for n in range(layer.used.count[0]):
        cell = layer.used.numbers[n]
        row = layer.share[cell]
        for c in range(row.size):
            value = row[c]
            if value != 0:
                weight = layer.weight[cell, c]
                for o in range(channels):
                    out[o] += value * weight[o]
                layer.products[0] += channels
                row[c] = 0.0
    clear(layer.used)


@njit
def _add_own(layer, row, features, way):
    """Add what a node gives itself."""
    own = layer.own[row]
    for c in range(layer.root.shape[0]):
        value = way * features[c]
        if value != 0:
            root = layer.root[c]
            for o in range(own.size):
                own[o] += value * root[o]
            layer.products[0] += own.size


@njit
def _finish(layer, row, degree):
    """A row's output: the mean over its edges, and its own part."""
    share = 1.0 / degree if degree else 0.0
    for o in range(layer.bias.size):
        layer.out[row, o] = layer.sum[row, o] * share + layer.own[row, o]
