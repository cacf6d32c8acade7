"""B-spline convolutions of graphs that change: only rows whose inputs changed are computed, from what changed in them.

The sum over a node's edges is kept in float64, so that what was added can be taken away: a target with few changed
edges adds the difference of each, one with many is summed anew. Zeros, of which ReLU makes many, aren't multiplied.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from nvsdata.kernels.compiling import njit
from nvsdata.kernels.live_clusters import grid_of, neighbor
from nvsdata.kernels.marks import Marks, clear, mark

TOGETHER = 16  # targets that are multiplied with each weight while it is in the cache
OLD = 500  # differences after which a sum is made anew, so that their rounding doesn't add up


class Features(NamedTuple):
    """Features of nodes: `values` float32 [nodes, C], and what they were `before` this step where they `changed`."""

    values: np.ndarray
    before: np.ndarray
    changed: Marks


class Layer(NamedTuple):
    """A convolution with folded normalization, and the rows of its graph.

    - `weight` float32 [kernels + 1, in, out]: of the kernel's cells, then of the node itself; `bias` float32 [out]
    - `size`: cells of the kernel along an axis; `loops`: 1 if a node is its own neighbor; `own`: 1 if it adds its own
      features; `signed`: of the pseudo-coordinates
    - `reach` float32 [axes]: differences that end an axis
    - `sums` float64 [nodes, 2, out]: over the edges, and of the node itself; `out` float32 [nodes, out]
    - `degree`, `age` int64 [nodes]: edges of the nodes computed last, and how often their sums were added to
    - `dirty`: nodes to compute, and afterwards those that were
    - `share` float32 [TOGETHER, kernels + 1, in], `used` bool [TOGETHER, kernels + 1]: what targets sum up, and where;
      `product` float32 [TOGETHER, 2, out]: that, times the weights
    - `products` int64 [1]: multiplications so far
    """

    weight: np.ndarray
    bias: np.ndarray
    size: int
    loops: int
    own: int
    signed: bool
    reach: np.ndarray
    sums: np.ndarray
    out: np.ndarray
    degree: np.ndarray
    age: np.ndarray
    dirty: Marks
    share: np.ndarray
    used: np.ndarray
    product: np.ndarray
    products: np.ndarray


@njit
def convolve_events(window, layer, features):
    """Compute the dirty rows of events, each anew: they have few features. Those left are `dirty` afterwards."""
    left, first, mask = 0, window.ends[0], window.t.size - 1
    for n in range(layer.dirty.count[0]):
        row = layer.dirty.numbers[n]
        layer.dirty.marked[row] = False
        if first + ((row - first) & mask) < window.ends[1]:
            layer.dirty.numbers[left] = row
            left += 1
    layer.dirty.count[0] = left
    convolve_rows(window, layer, features, layer.dirty.numbers[:left])


@njit
def convolve_rows(window, layer, features, chosen):
    """Compute rows of events, each anew."""
    t, xs, ys, sources, mask = window.t, window.x, window.y, window.source, window.t.size - 1
    kernel, share, used = kernel_of(layer), layer.share, layer.used
    for start in range(0, chosen.size, TOGETHER):
        rows = chosen[start : min(start + TOGETHER, chosen.size)]
        for at in range(rows.size):
            row = rows[at]
            layer.degree[row] = window.degree[row] + layer.loops
            layer.sums[row, 0], layer.sums[row, 1] = 0.0, layer.bias
            for edge in range(window.degree[row]):
                other = sources[row, edge] & mask
                away = xs[other] - xs[row], ys[other] - ys[row], t[other] - t[row]
                _add(share, used, kernel, at, features, features, other, away, 1, False)
            _add_self(layer, at, features, features, row, False)
        _multiply(layer, rows)


@njit
def convolve_cells(cells, layer, features):
    """Compute the rows of a pooled graph whose inputs changed; those computed are `dirty` afterwards."""
    _mark_targets(cells, layer, features)
    left = 0
    for n in range(layer.dirty.count[0]):
        cell = layer.dirty.numbers[n]
        layer.dirty.marked[cell] = False
        if cells.members[cell]:
            layer.dirty.numbers[left] = cell
            left += 1
    layer.dirty.count[0] = left
    for start in range(0, left, TOGETHER):
        rows = layer.dirty.numbers[start : min(start + TOGETHER, left)]
        for at in range(rows.size):
            _sum_up(cells, layer, features, at, rows[at])
        _multiply(layer, rows)
    clear(features.changed)


@njit
def _mark_targets(cells, layer, features):
    """Mark the nodes whose rows may change."""
    edge, grid, dirty = cells.edge, grid_of(cells), layer.dirty
    offsets = edge.shape[1]
    for marks in (cells.moved, features.changed):
        for n in range(marks.count[0]):
            cell = marks.numbers[n]
            mark(dirty, cell)
            for offset in range(offsets):
                # an edge to it lies where the offset from it is the opposite one
                other = neighbor(grid, cell, offset)
                if other >= 0 and edge[other, offsets - 1 - offset]:
                    mark(dirty, other)
    for n in range(cells.turned.count[0]):
        mark(dirty, cells.turned.numbers[n] // offsets)


@njit
def _sum_up(cells, layer, features, at, cell):
    """What a node sums up: all of it if it moved, or most of it changed; otherwise what is different."""
    edge, turned, grid = cells.edge, cells.turned.marked, grid_of(cells)
    changed, moved = features.changed.marked, cells.moved.marked
    values, before, place, was = features.values, features.before, cells.place, cells.was
    kernel, share, used = kernel_of(layer), layer.share, layer.used
    offsets = edge.shape[1]
    # in halves: of features that changed, half the channels did, say
    degree, different = layer.loops, np.int64(changed[cell])
    for offset in range(offsets):
        now = edge[cell, offset]
        degree += now
        if turned[cell * offsets + offset]:
            different += 2
        elif now:
            source = neighbor(grid, cell, offset)
            # taken away and added, or only what is different
            different += 4 if moved[source] else np.int64(changed[source])
    layer.degree[cell] = degree
    anew = moved[cell] or different > 2 * degree or layer.age[cell] >= OLD
    layer.age[cell] += 1
    if anew:
        layer.sums[cell, 0], layer.sums[cell, 1], layer.age[cell] = 0.0, layer.bias, 0
        _add_self(layer, at, values, values, cell, False)
    elif changed[cell]:
        _add_self(layer, at, values, before, cell, True)
    for offset in range(offsets):
        now, new = edge[cell, offset], turned[cell * offsets + offset]
        if not (now or new):
            continue
        source = neighbor(grid, cell, offset)
        if not (anew or new or moved[source] or changed[source]):
            continue
        # `less`: what it added before is to be taken away, because it is gone, changed or moved
        away, less = _away(place, source, place, cell), not anew and now != new
        if now and less and not moved[source]:
            _add(share, used, kernel, at, values, before, source, away, 1, True)
            continue
        if now:
            _add(share, used, kernel, at, values, values, source, away, 1, False)
        if less:
            old = before if changed[source] else values
            away = _away(was if moved[source] else place, source, place, cell)
            _add(share, used, kernel, at, old, old, source, away, -1, False)


@njit(inline="always")
def _away(sources, source, targets, target):
    """Where a source is, as seen from a target."""
    dx, dy = sources[source, 0] - targets[target, 0], sources[source, 1] - targets[target, 1]
    return dx, dy, sources[source, 2] - targets[target, 2]


@njit
def _add_self(layer, at, features, before, node, less):
    """Add a node's features to its own, `less` those before if asked for."""
    if layer.loops:
        _add(layer.share, layer.used, kernel_of(layer), at, features, before, node, (0, 0, 0), 1, less)
    if layer.own:
        last = layer.used.shape[1] - 1
        _add_to(layer.share, layer.used, at, last, features, before, node, np.float32(1), less)


@njit(inline="always")
def kernel_of(layer):
    """What placing an edge in the kernel needs: whole layers take long to pass on."""
    return layer.size, layer.signed, layer.reach


@njit
def _add(share, used, kernel, at, features, before, node, away, way, less):
    """Add a source's features, `less` those before if asked for, to the kernel cells that an edge touches.

    Their shares are B-splines of degree 1; `way` is -1 to take away.
    """
    size, axes = kernel[0], kernel[2].size
    if size == 1:
        _add_to(share, used, at, 0, features, before, node, np.float32(way), less)
        return
    i, u = _place(kernel, 0, away[0])
    j, v = _place(kernel, 1, away[1])
    k, w, one = 0, np.float32(0), np.float32(1)
    if axes > 2:
        k, w = _place(kernel, 2, away[2])
    for corner in range(8 if axes > 2 else 4):
        a, b, c = corner & 1, corner >> 1 & 1, corner >> 2
        part = (u if a else one - u) * (v if b else one - v) * (w if c else one - w)
        if part != 0:
            cell = i + a + size * (j + b + size * (k + c))
            _add_to(share, used, at, cell, features, before, node, np.float32(way) * part, less)


@njit
def _place(kernel, axis, difference):
    """The lower of the kernel's cells along an axis, and the share of the upper one; in float32, as in batches."""
    size, signed, reach = kernel
    d = np.float32(difference) / reach[axis]
    if signed:
        u = min(max(d * np.float32(0.5) + np.float32(0.5), np.float32(0)), np.float32(1))
    else:
        u = min(abs(d), np.float32(1))
    v = u * np.float32(size - 1)
    lower = min(int(v), size - 2)
    return lower, v - np.float32(lower)


@njit
def _add_to(share, used, at, cell, features, before, node, part, less):
    """Add a share of a node's features, or of what is different in them, to a kernel cell of a target."""
    used[at, cell] = True
    if less:
        for c in range(features.shape[1]):
            share[at, cell, c] += part * (features[node, c] - before[node, c])
    else:
        for c in range(features.shape[1]):
            share[at, cell, c] += part * features[node, c]


@njit
def _multiply(layer, rows):
    """Add what targets have summed up, times the weights, and forget it; then their outputs are the means."""
    users, products = np.empty(TOGETHER, np.int64), 0
    kernels, channels = layer.used.shape[1], layer.bias.size
    used, shares, weights, product = layer.used, layer.share, layer.weight, layer.product
    for cell in range(kernels):
        part, count = np.int64(cell == kernels - 1), 0
        for at in range(rows.size):
            if used[at, cell]:
                used[at, cell] = False
                users[count] = at
                count += 1
        # a weight serves all targets while it is in the cache
        for c in range(weights.shape[1] if count else 0):
            for n in range(count):
                at = users[n]
                value = shares[at, cell, c]
                if value != 0:
                    shares[at, cell, c] = 0
                    for o in range(channels):
                        product[at, part, o] += value * weights[cell, c, o]
                    products += channels
    layer.products[0] += products
    sums, out = layer.sums, layer.out
    for at in range(rows.size):
        row = rows[at]
        share = 1.0 / layer.degree[row] if layer.degree[row] else 0.0
        for o in range(channels):
            sums[row, 0, o] += product[at, 0, o]
            sums[row, 1, o] += product[at, 1, o]
            out[row, o] = sums[row, 0, o] * share + sums[row, 1, o]
            product[at, 0, o], product[at, 1, o] = 0, 0
