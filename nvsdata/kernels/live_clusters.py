"""Pooled graphs that follow changes of the graph below: the clusters of `kernels.pool`, as integers that add up.

A cluster is a cell of a grid and its number is its node's. Positions are sums over members, edges are counted, so that
members and edges can go. A step marks what it touches; `settle` then tells what is different from before.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from nvsdata.kernels.compiling import njit
from nvsdata.kernels.marks import Marks, mark


class Cells(NamedTuple):
    """A pooled graph.

    - `width`, `height`: of a cell in pixels; `columns`, `rows`: of the grid
    - `across`, `down`: most cells between the ends of an edge; its place among a cell's `offsets` tells the source
    - `members` int64 [cells], `sums` int64 [cells, 3]: how many nodes below, and the sums of their x, y and t
    - `place`, `was` int64 [cells, 3]: x, y and t of the nodes now, and before the step where they `moved`; without
      members `place` means nothing
    - `alive` bool [cells]: whether there was a node when the last step settled
    - `count` int32, `edge` bool [cells, offsets]: edges below between two cells, and whether there is one here
    - `home` int64 [cells]: the cell of the graph above, -1 without
    - `head`, `after`, `previous` int64: the first member of a cell [cells], and the next and the one before it by
      number of the node below, modulo their size; -1 where there is none
    - `touched`, `moved`: cells; `counted`, `turned`: edges, as cell * offsets + offset; `rescan`: cells that lost or
      gained a member whose features may count
    """

    width: int
    height: int
    columns: int
    rows: int
    across: int
    down: int
    members: np.ndarray
    sums: np.ndarray
    place: np.ndarray
    was: np.ndarray
    alive: np.ndarray
    count: np.ndarray
    edge: np.ndarray
    home: np.ndarray
    head: np.ndarray
    after: np.ndarray
    previous: np.ndarray
    touched: Marks
    moved: Marks
    counted: Marks
    turned: Marks
    rescan: Marks


@njit(inline="always")
def cell_of(cells, x, y):
    """The cell of a position; those beyond the grid belong to its border."""
    return min(y // cells.height, cells.rows - 1) * cells.columns + min(x // cells.width, cells.columns - 1)


@njit(inline="always")
def offset_of(cells, target, source):
    """Which of a cell's offsets leads to another one."""
    wide = 2 * cells.across + 1
    dx = source % cells.columns - target % cells.columns + cells.across
    return (source // cells.columns - target // cells.columns + cells.down) * wide + dx


@njit(inline="always")
def neighbor(cells, cell, offset):
    """The cell at an offset, -1 beyond the grid."""
    wide = 2 * cells.across + 1
    x = cell % cells.columns + offset % wide - cells.across
    y = cell // cells.columns + offset // wide - cells.down
    return y * cells.columns + x if 0 <= x < cells.columns and 0 <= y < cells.rows else -1


@njit
def add_member(cells, cell, node, x, y, t):
    """Put a node below into a cell."""
    cells.members[cell] += 1
    cells.sums[cell, 0] += x
    cells.sums[cell, 1] += y
    cells.sums[cell, 2] += t
    first, slots = cells.head[cell], cells.after.size
    cells.after[node % slots], cells.previous[node % slots] = first, -1
    if first >= 0:
        cells.previous[first % slots] = node
    cells.head[cell] = node
    mark(cells.touched, cell)


@njit
def remove_member(cells, cell, node, x, y, t):
    """Take a node below out of a cell."""
    cells.members[cell] -= 1
    cells.sums[cell, 0] -= x
    cells.sums[cell, 1] -= y
    cells.sums[cell, 2] -= t
    slots = cells.after.size
    after, previous = cells.after[node % slots], cells.previous[node % slots]
    if previous >= 0:
        cells.after[previous % slots] = after
    else:
        cells.head[cell] = after
    if after >= 0:
        cells.previous[after % slots] = previous
    mark(cells.touched, cell)


@njit(inline="always")
def count_edge(cells, target, source, number):
    """Add `number` edges below, from a node of cell `source` to one of `target`."""
    if source != target:
        offset = offset_of(cells, target, source)
        cells.count[target, offset] += number
        mark(cells.counted, target * cells.count.shape[1] + offset)


@njit
def settle(cells):
    """Find the nodes that moved, came or went, and the edges that are new or gone. O(what was touched)."""
    offsets = cells.count.shape[1]
    for n in range(cells.touched.count[0]):
        cell = cells.touched.numbers[n]
        members, alive = cells.members[cell], cells.alive[cell]
        cells.touched.marked[cell] = False
        for axis in range(3):
            cells.was[cell, axis] = cells.place[cell, axis]
        same = alive == (members > 0)
        if members:
            for axis in range(3):
                # rounded down, times before the first event, too
                cells.place[cell, axis] = cells.sums[cell, axis] // members
                same &= cells.place[cell, axis] == cells.was[cell, axis]
        if not same and (alive or members):
            mark(cells.moved, cell)
    cells.touched.count[0] = 0
    for n in range(cells.counted.count[0]):
        number = cells.counted.numbers[n]
        target, offset = number // offsets, number % offsets
        cells.counted.marked[number] = False
        now = cells.count[target, offset] > 0
        if now != cells.edge[target, offset]:
            cells.edge[target, offset] = now
            mark(cells.turned, number)
    cells.counted.count[0] = 0


@njit
def lift(cells, above):
    """Tell the graph above what has changed in a settled one, and settle it."""
    offsets = cells.count.shape[1]
    for n in range(cells.turned.count[0]):
        number = cells.turned.numbers[n]
        target = number // offsets
        source = neighbor(cells, target, number % offsets)
        if cells.home[target] >= 0 and cells.home[source] >= 0:
            way = 1 if cells.edge[target, number % offsets] else -1
            count_edge(above, cells.home[target], cells.home[source], way)
    for n in range(cells.moved.count[0]):
        cell = cells.moved.numbers[n]
        x, y, t = cells.place[cell]
        old = cells.home[cell]
        new = cell_of(above, x, y) if cells.members[cell] else -1
        if old >= 0:
            remove_member(above, old, cell, *_triple(cells.was, cell))
        if new >= 0:
            add_member(above, new, cell, x, y, t)
        if new != old:
            if old >= 0:
                _count_all(cells, above, cell, -1)
                mark(above.rescan, old)
            cells.home[cell] = new
            if new >= 0:
                _count_all(cells, above, cell, 1)
                mark(above.rescan, new)
    settle(above)


@njit
def _triple(values, cell):
    return values[cell, 0], values[cell, 1], values[cell, 2]


@njit
def _count_all(cells, above, cell, way):
    """Add, or take away, all edges of a node in the graph above."""
    home = cells.home[cell]
    for offset in range(cells.edge.shape[1]):
        other = neighbor(cells, cell, offset)
        if other < 0 or cells.home[other] < 0:
            continue
        if cells.edge[cell, offset]:
            count_edge(above, home, cells.home[other], way)
        if cells.edge[other, offset_of(cells, other, cell)]:
            count_edge(above, cells.home[other], home, way)


@njit
def rest(cells):
    """Forget what has changed, when everybody has been told."""
    for n in range(cells.moved.count[0]):
        cell = cells.moved.numbers[n]
        cells.moved.marked[cell] = False
        cells.alive[cell] = cells.members[cell] > 0
    cells.moved.count[0] = 0
    for n in range(cells.turned.count[0]):
        cells.turned.marked[cells.turned.numbers[n]] = False
    cells.turned.count[0] = 0
