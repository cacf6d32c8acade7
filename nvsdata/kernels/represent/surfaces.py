"""Time surfaces: how long ago pixels had their last event, as exponentials; and their averages in cells (hats.cpp).

IndexError for events outside of them.
"""

from __future__ import annotations

import numpy as np

from nvsdata.kernels import _native


def surfaces(
    t: np.ndarray,
    x: np.ndarray,
    y: np.ndarray,
    p: np.ndarray,
    times: np.ndarray,
    bounds: np.ndarray,
    tau: float,
    grown: np.ndarray,
    out: np.ndarray,
) -> None:
    """Fill `out` float32 [T, 2, H, W] with exp(-(times[n] - t) / tau) of each pixel's and polarity's last event.

    Frame n includes the events up to `bounds[n + 1]`, none later than `times[n]`. `grown` float64 [2, H, W] is scratch,
    0. ON comes first. O(N + output).
    """
    _native.surfaces(t, x, y, p, times, bounds, tau, grown, out)


def event_surfaces(
    t: np.ndarray,
    x: np.ndarray,
    y: np.ndarray,
    p: np.ndarray,
    tau: float,
    radius: int,
    grown: np.ndarray,
    epochs: np.ndarray,
    out: np.ndarray,
) -> None:
    """Fill `out` float32 [N, 1, side, side] with the surface of each event's polarity around it, itself included.

    With `out` [N, 2, side, side], the surfaces of both polarities, ON first. `grown` float64 and `epochs` int64, both
    [2, H + 2 radius, W + 2 radius], are scratch, 0. O(N side²).
    """
    _native.event_surfaces(t, x, y, p, tau, radius, grown, epochs, out)


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
