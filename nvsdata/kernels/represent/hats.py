"""Histograms of averaged time surfaces."""

from __future__ import annotations

import numpy as np

from nvsdata.kernels import _native


def sum_surfaces(
    t: np.ndarray,
    x: np.ndarray,
    y: np.ndarray,
    p: np.ndarray,
    cell: int,
    radius: int,
    window: int,
    tau: float,
    sums: np.ndarray,
    epochs: np.ndarray,
    members: np.ndarray,
    out: np.ndarray,
    events: np.ndarray,
) -> None:
    """Add the local memory time surfaces of each cell's events to `out` float64 [cells, 2, side, side].

    `events` int64 [cells] gets the cells' numbers of events; `sums` float64, `epochs` and `members` int64, all
    [2, H, W], are scratch, 0, like both. O(N side²), because each pixel keeps the sum of its events' exponentials (see
    epochs.h), which enter it when time goes on and leave it after `window`. IndexError for events outside the sensor.
    """
    _native.sum_surfaces(t, x, y, p, min(cell, 32_768), radius, window, tau, sums, epochs, members, out, events)
