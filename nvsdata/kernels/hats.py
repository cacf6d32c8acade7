"""Histograms of averaged time surfaces."""

from __future__ import annotations

import numpy as np

from nvsdata.kernels.compiling import njit
from nvsdata.kernels.surfaces import epoch_of


@njit
def sum_surfaces(t, x, y, p, cell, radius, window, tau, sums, epochs, members, out, events):
    """Add the local memory time surfaces of each cell's events to `out` float64 [cells, 2, side, side].

    `events` int64 [cells] gets the cells' numbers of events; `sums` float64, `epochs` and `members` int64, all
    [2, H, W], are scratch, 0, like both. O(N side²), because each pixel keeps the sum of its events' exponentials (see
    `kernels/surfaces.py` for epochs), which enter it when time goes on and leave it after `window`.
    """
    _, height, width = sums.shape
    columns = (width + cell - 1) // cell
    value, epoch = np.empty(t.size), np.empty(t.size, np.int64)
    entered = left = 0
    length = epoch_of(tau)
    old = np.exp(-length / tau)
    for i in range(t.size):
        epoch[i] = (t[i] - t[0]) // length
        value[i] = np.exp((t[i] - t[0] - epoch[i] * length) / tau)
        while t[entered] < t[i]:
            _enter(entered, x, y, p, value, epoch, old, sums, epochs, members)
            entered += 1
        while left < entered and t[i] - t[left] > window:
            _leave(left, x, y, p, value, epoch, old, sums, epochs, members)
            left += 1
        row, column = y[i] // cell, x[i] // cell
        home, channel = row * columns + column, 1 - p[i]
        events[home] += 1
        y0, y1 = max(y[i] - radius, row * cell), min(y[i] + radius + 1, (row + 1) * cell, height)
        x0, x1 = max(x[i] - radius, column * cell), min(x[i] + radius + 1, (column + 1) * cell, width)
        near, ages = sums[channel, y0:y1, x0:x1], epochs[channel, y0:y1, x0:x1]
        surface = out[home, channel, y0 - y[i] + radius :, x0 - x[i] + radius :]
        shrink = 1 / value[i]
        for r in range(np.uint64(y1 - y0)):
            for c in range(np.uint64(x1 - x0)):
                # mostly nothing was there
                if near[r, c]:
                    surface[r, c] += near[r, c] * _faded(epoch[i] - ages[r, c], old) * shrink


@njit(inline="always")
def _faded(epochs, old):
    """What is left of a value after some epochs, `old` being that after one."""
    return 1.0 if epochs == 0 else old if epochs == 1 else 0.0


@njit
def _enter(j, x, y, p, value, epoch, old, sums, epochs, members):
    place = 1 - p[j], y[j], x[j]
    sums[place] = sums[place] * _faded(epoch[j] - epochs[place], old) + value[j]
    epochs[place] = epoch[j]
    members[place] += 1


@njit
def _leave(j, x, y, p, value, epoch, old, sums, epochs, members):
    place = 1 - p[j], y[j], x[j]
    members[place] -= 1
    # the oldest value is the smallest, so little is lost; nothing at all of the last one
    sums[place] = sums[place] - value[j] * _faded(epochs[place] - epoch[j], old) if members[place] else 0.0
