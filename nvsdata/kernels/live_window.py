"""A step of a window that slides: events go and come, and pooled graphs, their features and the network follow."""

from __future__ import annotations

import numpy as np

from nvsdata.kernels.compiling import njit
from nvsdata.kernels.live_clusters import add_member, cell_of, count_edge, grid_of, lift, remove_member, rest, settle
from nvsdata.kernels.live_layers import convolve_cells, convolve_events
from nvsdata.kernels.live_neighbors import farthest, lists_of, offer, pop, push, row_of, search
from nvsdata.kernels.live_pooling import activate, pool, read_out
from nvsdata.kernels.marks import clear, mark
from nvsdata.kernels.neighbors import near_sources


@njit
def step(window, metric, cells, layers, features, plan, readout, near, until, t, x, y, given):
    """Remove the events before time `until`, append others, and bring everything up to date.

    - `cells`: the pooled graphs, each of the one before; `layers`: convolutions, the first of events; `features`: what
      each layer takes, and what the last one gives
    - `plan` int64 [layers, 2]: which of `cells` a layer's rows are pooled into, -1 for none; and 1 for their average
    - `given` float32 [new events, C]: features of the events
    """
    first = window.ends[1]
    slide(window, cells[0], metric, near, layers[0].dirty, until, t, x, y)
    for n in range(t.size):
        features[0].values[row_of(window, first + n)] = given[n]
    for level in range(len(cells) - 1):
        lift(cells[level], cells[level + 1])
    convolve_events(window, layers[0], features[0].values)
    rows = layers[0].dirty
    for n in range(rows.count[0]):
        row = rows.numbers[n]
        mark(cells[0].rescan, cell_of(cells[0], window.x[row], window.y[row]))
    level = 0
    for n in range(len(layers)):
        layer = layers[n]
        if n:
            convolve_cells(cells[level], layer, features[n])
        if plan[n, 0] < 0:
            activate(layer.dirty, layer.out, features[n + 1])
        else:
            if n:
                for m in range(layer.dirty.count[0]):
                    mark(cells[level + 1].rescan, cells[level].home[layer.dirty.numbers[m]])
                level += 1
            pool(cells[level], layer.out, plan[n, 1], features[n + 1])
        # their marks are gone already
        layer.dirty.count[0] = 0
    read_out(cells[level], features[len(layers)], readout)
    for level in range(len(cells)):
        rest(cells[level])


@njit
def slide(window, cells, metric, near, dirty, until, t, x, y):
    """Remove the events before time `until` and append others, which are no earlier than those there.

    `near`: pixels, `dirty`: rows whose neighbors changed; both without marks at first.
    """
    k = window.source.shape[1]
    while window.ends[0] < window.ends[1] and window.t[row_of(window, window.ends[0])] < until:
        _leave(window, cells, metric, near)
    source, degree, slots, mask, first = window.source, window.degree, window.slots, window.t.size - 1, window.ends[0]
    for n in range(near.count[0]):
        pixel = near.numbers[n]
        begin = window.begin[pixel]
        # the others have nearer ones in their own pixel
        for slot in range(begin, begin + min(window.size[pixel], k)):
            row = slots[slot] & mask
            if _lost(source[row], degree[row], first):
                _forget(window, cells, metric, dirty, slots[slot])
    clear(near)
    if window.ends[0] == window.ends[1]:
        _fill(window, cells, metric, dirty, t, x, y)
        t = t[:0]
    for n in range(t.size):
        number = window.ends[1]
        push(window, number, t[n], x[n], y[n])
        _arrive(window, cells, metric, dirty, number)
    settle(cells)


@njit
def _fill(window, cells, metric, dirty, t, x, y):
    """Append events to an empty window: all neighbors at once, which takes less time than one after the other."""
    first, k = window.ends[1], window.source.shape[1]
    degree, source = near_sources(t, x, y, metric.radius, metric.alpha, metric.beta, k)
    lists, mask = lists_of(window), window.t.size - 1
    for i in range(t.size):
        push(window, first + i, t[i], x[i], y[i])
        row = (first + i) & mask
        window.degree[row] = degree[i]
        for n in range(degree[i]):
            j = source[i, n]
            dx, dy, gap = np.int64(x[j]) - x[i], np.int64(y[j]) - y[i], np.float64(abs(t[j] - t[i]))
            window.source[row, n] = first + j
            window.far[row, n] = metric.alpha * (dx * dx + dy * dy) + metric.beta * (gap * gap)
        add_member(cells, cell_of(cells, x[i], y[i]), first + i, x[i], y[i], t[i])
        mark(dirty, row)
    for i in range(t.size):
        row = (first + i) & mask
        farthest(lists, mask, row)
        _count_own(window, cells, row, cell_of(cells, x[i], y[i]), 1)


@njit
def _leave(window, cells, metric, near):
    """Remove the oldest event, its own edges, and mark the pixels near it."""
    number = window.ends[0]
    row = row_of(window, number)
    x, y = window.x[row], window.y[row]
    home = cell_of(cells, x, y)
    _count_own(window, cells, row, home, -1)
    remove_member(cells, home, number, x, y, window.t[row])
    mark(cells.rescan, home)
    pop(window)
    width, height, offsets = window.width, window.height, metric.offsets
    for n in range(len(offsets)):
        u, v = x + offsets[n, 0], y + offsets[n, 1]
        if 0 <= u < width and 0 <= v < height:
            mark(near, v * width + u)


@njit
def _forget(window, cells, metric, dirty, number):
    """Remove the neighbors of an event that have gone, and find others in their place."""
    row = row_of(window, number)
    home, degree = cell_of(cells, window.x[row], window.y[row]), window.degree[row]
    mark(dirty, row)
    if degree == window.source.shape[1]:
        # others may have been too far
        _count_own(window, cells, row, home, -1)
        search(window, number, metric)
        _count_own(window, cells, row, home, 1)
        return
    kept, mask, grid = 0, window.t.size - 1, grid_of(cells)
    for n in range(degree):
        source = window.source[row, n]
        if source >= window.ends[0]:
            window.source[row, kept], window.far[row, kept] = source, window.far[row, n]
            kept += 1
        else:
            there = cell_of(cells, window.x[source & mask], window.y[source & mask])
            count_edge(cells.count, cells.counted, grid, home, there, -1)
    window.degree[row] = kept
    farthest(lists_of(window), mask, row)


@njit
def _lost(source, degree, first):
    """Whether an event's neighbors have numbers below `first`."""
    lost = False
    for n in range(degree):
        lost |= source[n] < first
    return lost


@njit
def _arrive(window, cells, metric, dirty, number):
    """Find the neighbors of an event that has come, and whose neighbor it is."""
    lists, slots, mask, k = lists_of(window), window.slots, window.t.size - 1, window.source.shape[1]
    source, far, degree, worst = window.source, window.far, window.degree, window.worst
    begins, size, xs, ys = window.begin, window.size, window.x, window.y
    offsets, apart, limit, beta = metric.offsets, metric.apart, metric.limit, metric.beta
    count, counted, grid = cells.count, cells.counted, grid_of(cells)
    row = number & mask
    x, y = xs[row], ys[row]
    home = cell_of(cells, x, y)
    add_member(cells, home, number, x, y, window.t[row])
    search(window, number, metric)
    _count_own(window, cells, row, home, 1)
    mark(dirty, row)
    for n in range(apart.size):
        u, v = x + offsets[n, 0], y + offsets[n, 1]
        if not (0 <= u < window.width and 0 <= v < window.height):
            continue
        begin = begins[v * window.width + u]
        end = begin + size[v * window.width + u]
        # the others have nearer ones in their own pixel
        for slot in range(end - 1, max(end - k - 1 - (n == 0), begin - 1), -1):
            other = slots[slot]
            place = other & mask
            full = degree[place] == k
            if other == number or (full and apart[n] > far[place, worst[place]]):
                continue
            last = source[place, worst[place]] & mask
            if offer(lists, mask, place, number, apart[n], limit, beta):
                there = cell_of(cells, xs[place], ys[place])
                if full:
                    count_edge(count, counted, grid, there, cell_of(cells, xs[last], ys[last]), -1)
                count_edge(count, counted, grid, there, home, 1)
                mark(dirty, place)


@njit
def _count_own(window, cells, row, home, way):
    """Add, or take away, the edges to an event."""
    source, xs, ys, mask = window.source, window.x, window.y, window.t.size - 1
    count, counted, grid = cells.count, cells.counted, grid_of(cells)
    for n in range(window.degree[row]):
        other = source[row, n] & mask
        count_edge(count, counted, grid, home, cell_of(cells, xs[other], ys[other]), way)
