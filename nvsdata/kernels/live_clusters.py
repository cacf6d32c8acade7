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
    - `axes`: of places that count, 2, or 3 with time
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
    axes: int
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
def grid_of(cells):
    """What finding cells and offsets needs: whole graphs take long to pass on."""
    return cells.width, cells.height, cells.columns, cells.rows, cells.across, cells.down


@njit
def offset_of(grid, target, source):
    """Which of a cell's offsets leads to another one."""
    _, _, columns, _, across, down = grid
    return (
        (source // columns - target // columns + down) * (2 * across + 1) + source % columns - target % columns + across
    )


@njit
def neighbor(grid, cell, offset):
    """The cell at an offset, -1 beyond the grid."""
    _, _, columns, rows, across, down = grid
    wide = 2 * across + 1
    x = cell % columns + offset % wide - across
    y = cell // columns + offset // wide - down
    return y * columns + x if 0 <= x < columns and 0 <= y < rows else -1


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


@njit
def count_edge(count, counted, grid, target, source, number):
    """Add `number` edges below, from a node of cell `source` to one of `target`."""
    if source != target:
        offset = offset_of(grid, target, source)
        count[target, offset] += number
        mark(counted, target * count.shape[1] + offset)


@njit
def settle(cells):
    """Find the nodes that moved, came or went, and the edges that are new or gone. O(what was touched)."""
    offsets = cells.count.shape[1]
    for n in range(cells.touched.count[0]):
        cell = cells.touched.numbers[n]
        members, alive = cells.members[cell], cells.alive[cell]
        cells.touched.marked[cell] = False
        for axis in range(cells.axes):
            cells.was[cell, axis] = cells.place[cell, axis]
        same = alive == (members > 0)
        if members:
            # without its axis, time stays 0, because it changes with each event
            for axis in range(cells.axes):
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
    offsets, home, edge = cells.count.shape[1], cells.home, cells.edge
    grid, wide, count, counted = grid_of(cells), grid_of(above), above.count, above.counted
    for n in range(cells.turned.count[0]):
        number = cells.turned.numbers[n]
        target = number // offsets
        source = neighbor(grid, target, number % offsets)
        if home[target] >= 0 and home[source] >= 0:
            way = 1 if edge[target, number % offsets] else -1
            count_edge(count, counted, wide, home[target], home[source], way)
    for n in range(cells.moved.count[0]):
        cell = cells.moved.numbers[n]
        x, y, t = cells.place[cell, 0], cells.place[cell, 1], cells.place[cell, 2]
        old = home[cell]
        new = cell_of(above, x, y) if cells.members[cell] else -1
        if old >= 0:
            remove_member(above, old, cell, cells.was[cell, 0], cells.was[cell, 1], cells.was[cell, 2])
        if new >= 0:
            add_member(above, new, cell, x, y, t)
        if new != old:
            if old >= 0:
                _count_all(edge, home, grid, count, counted, wide, cell, -1)
                mark(above.rescan, old)
            home[cell] = new
            if new >= 0:
                _count_all(edge, home, grid, count, counted, wide, cell, 1)
                mark(above.rescan, new)
    settle(above)


@njit
def _count_all(edge, home, grid, count, counted, wide, cell, way):
    """Add, or take away, all edges of a node in the graph above."""
    for offset in range(edge.shape[1]):
        other = neighbor(grid, cell, offset)
        if other < 0 or home[other] < 0:
            continue
        if edge[cell, offset]:
            count_edge(count, counted, wide, home[cell], home[other], way)
        # an edge from it lies where the offset is the opposite one
        if edge[other, edge.shape[1] - 1 - offset]:
            count_edge(count, counted, wide, home[other], home[cell], way)


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
