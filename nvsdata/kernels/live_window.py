"""A step of a window that slides: events go and come, and pooled graphs, their features and the network follow."""

from __future__ import annotations

from nvsdata.kernels.compiling import njit
from nvsdata.kernels.live_clusters import add_member, cell_of, count_edge, lift, remove_member, rest, settle
from nvsdata.kernels.live_layers import convolve_cells, convolve_events
from nvsdata.kernels.live_neighbors import farthest, offer, pop, push, row_of, search
from nvsdata.kernels.live_pooling import activate, pool, read_out
from nvsdata.kernels.marks import clear, mark


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
    for n in range(near.count[0]):
        pixel = near.numbers[n]
        begin = window.begin[pixel]
        # the others have nearer ones in their own pixel
        for slot in range(begin, begin + min(window.size[pixel], k)):
            _forget(window, cells, metric, dirty, window.slots[slot])
    clear(near)
    for n in range(t.size):
        number = window.ends[1]
        push(window, number, t[n], x[n], y[n])
        _arrive(window, cells, metric, dirty, number)
    settle(cells)


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
    for v in range(max(y - metric.side, 0), min(y + metric.side + 1, window.height)):
        for u in range(max(x - metric.side, 0), min(x + metric.side + 1, window.width)):
            mark(near, v * window.width + u)


@njit
def _forget(window, cells, metric, dirty, number):
    """Remove the neighbors of an event that have gone, and find others in their place."""
    row = row_of(window, number)
    home, degree, kept = cell_of(cells, window.x[row], window.y[row]), window.degree[row], 0
    for n in range(degree):
        kept += window.source[row, n] >= window.ends[0]
    if kept == degree:
        return
    mark(dirty, row)
    if degree == window.source.shape[1]:
        # others may have been too far
        _count_own(window, cells, row, home, -1)
        search(window, number, metric)
        _count_own(window, cells, row, home, 1)
        return
    kept = 0
    for n in range(degree):
        source = window.source[row, n]
        if source >= window.ends[0]:
            window.source[row, kept], window.far[row, kept] = source, window.far[row, n]
            kept += 1
        else:
            count_edge(cells, home, _home(window, cells, source), -1)
    window.degree[row] = kept
    farthest(window, row, window.t[row])


@njit
def _arrive(window, cells, metric, dirty, number):
    """Find the neighbors of an event that has come, and whose neighbor it is."""
    row, k = row_of(window, number), window.source.shape[1]
    x, y, t = window.x[row], window.y[row], window.t[row]
    home = cell_of(cells, x, y)
    add_member(cells, home, number, x, y, t)
    search(window, number, metric)
    _count_own(window, cells, row, home, 1)
    mark(dirty, row)
    for v in range(max(y - metric.side, 0), min(y + metric.side + 1, window.height)):
        for u in range(max(x - metric.side, 0), min(x + metric.side + 1, window.width)):
            base = metric.alpha * ((u - x) * (u - x) + (v - y) * (v - y))
            if base > metric.limit:
                continue
            pixel = v * window.width + u
            end = window.begin[pixel] + window.size[pixel]
            # the others have nearer ones in their own pixel
            for slot in range(end - 1, max(end - k - 1 - (pixel == y * window.width + x), window.begin[pixel] - 1), -1):
                other = window.slots[slot]
                if other == number:
                    continue
                place = row_of(window, other)
                full = window.degree[place] == k
                last = window.source[place, window.worst[place]] if full else -1
                if offer(window, place, number, window.t[place], base, metric):
                    there = cell_of(cells, window.x[place], window.y[place])
                    if full:
                        count_edge(cells, there, _home(window, cells, last), -1)
                    count_edge(cells, there, home, 1)
                    mark(dirty, place)


@njit
def _count_own(window, cells, row, home, way):
    """Add, or take away, the edges to an event."""
    for n in range(window.degree[row]):
        count_edge(cells, home, _home(window, cells, window.source[row, n]), way)


@njit(inline="always")
def _home(window, cells, number):
    row = row_of(window, number)
    return cell_of(cells, window.x[row], window.y[row])
