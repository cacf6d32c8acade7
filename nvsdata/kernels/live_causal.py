"""Networks on causal graphs, event by event: a row is final once it is computed, and only maxima are forgotten.

Each cell of the grid has a queue of its events. The older part holds, at each event, the maximum of it and those after
it in this part; of the newer part one maximum is known. So an event costs one comparison of rows, when it comes and
when it goes.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from nvsdata.kernels.compiling import njit
from nvsdata.kernels.live_clusters import cell_of
from nvsdata.kernels.live_layers import convolve_rows
from nvsdata.kernels.live_neighbors import pop, push, row_of, search
from nvsdata.kernels.live_pooling import show
from nvsdata.kernels.marks import Marks, mark


class Queues(NamedTuple):
    """The events of each cell, in order.

    - `width`, `height`: of a cell in pixels; `columns`, `rows`: of the grid
    - `head`, `tail`, `settled` int64 [cells]: numbers of the first event, the last one, and the last one of the older
      part; -1 for none
    - `after`, `previous` int64 [capacity]: of each event in its queue, by row
    - `newer` float32 [cells, C]: maxima of the newer parts
    - `first` int64 [1]: number of the first event in the queues
    - `changed`: cells whose maxima may have
    """

    width: int
    height: int
    columns: int
    rows: int
    head: np.ndarray
    tail: np.ndarray
    settled: np.ndarray
    after: np.ndarray
    previous: np.ndarray
    newer: np.ndarray
    first: np.ndarray
    changed: Marks


@njit
def advance_causal(window, metric, age, until, layers, features, queues, t, x, y, given):
    """Take events: their neighbors among those of the last `age` µs, their rows, and their places in the queues.

    Afterwards events before time `until` are forgotten.

    `layers` are convolutions, `features` what each takes and what the last one gives, float32 [capacity, C].
    """
    first, mask = window.ends[1], window.t.size - 1
    rows = np.empty(t.size, np.int64)
    for n in range(t.size):
        _forget(window, t[n] - age + 1)
        push(window, first + n, t[n], x[n], y[n])
        search(window, first + n, metric)
        rows[n] = (first + n) & mask
        features[0][rows[n]] = given[n]
    for k in range(len(layers)):
        convolve_rows(window, layers[k], features[k], rows)
        out, values = layers[k].out, features[k + 1]
        for row in rows:
            for c in range(out.shape[1]):
                values[row, c] = max(out[row, c], np.float32(0))
    _forget(window, until)
    last = features[len(layers)]
    while queues.first[0] < min(window.ends[0], first):
        _leave(window, queues, last, queues.first[0])
        queues.first[0] += 1
    queues.first[0] = max(queues.first[0], window.ends[0])
    for number in range(max(first, window.ends[0]), window.ends[1]):
        _enter(window, queues, last, number)


@njit
def _forget(window, until):
    """Remove the events before a time from the window."""
    while window.ends[0] < window.ends[1] and window.t[row_of(window, window.ends[0])] < until:
        pop(window)


@njit
def _enter(window, queues, values, number):
    """Append an event to its cell's queue."""
    row, mask = number & (window.t.size - 1), window.t.size - 1
    cell = cell_of(queues, window.x[row], window.y[row])
    tail = queues.tail[cell]
    queues.previous[row], queues.after[row] = tail, -1
    if tail >= 0:
        queues.after[tail & mask] = number
    else:
        queues.head[cell] = number
    queues.tail[cell] = number
    for c in range(values.shape[1]):
        queues.newer[cell, c] = max(queues.newer[cell, c], values[row, c])
    mark(queues.changed, cell)


@njit
def _leave(window, queues, values, number):
    """Remove the first event of its cell's queue."""
    row, mask = number & (window.t.size - 1), window.t.size - 1
    cell = cell_of(queues, window.x[row], window.y[row])
    if queues.settled[cell] < number:
        # nothing is left of the older part: the newer one takes its place
        queues.settled[cell] = queues.tail[cell]
        at = queues.previous[queues.tail[cell] & mask]
        while at >= number:
            here, there = at & mask, queues.after[at & mask] & mask
            for c in range(values.shape[1]):
                values[here, c] = max(values[here, c], values[there, c])
            at = queues.previous[here]
        queues.newer[cell] = 0
    after = queues.after[row]
    queues.head[cell] = after
    if after >= 0:
        queues.previous[after & mask] = -1
    else:
        queues.tail[cell] = -1
    mark(queues.changed, cell)


@njit
def show_maxima(queues, values, mask, readout):
    """Bring the first fully connected layer up to date. O(changed maxima · hidden)."""
    for n in range(queues.changed.count[0]):
        cell = queues.changed.numbers[n]
        queues.changed.marked[cell] = False
        head = queues.head[cell]
        older = head >= 0 and head <= queues.settled[cell]
        maxima = queues.newer[cell]
        show(readout, cell, np.maximum(maxima, values[head & mask]) if older else maxima)
    queues.changed.count[0] = 0
