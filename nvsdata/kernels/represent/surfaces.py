"""Time surfaces: exponentials of the ages of the last events of pixels, and their averages in cells (hats.cpp).

Events outside a surface raise an IndexError.
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
    """Fill `out` float32 [T, 2, H, W] with exp(-(times[n] - t) / tau) of the last event of each pixel and polarity.

    Frame n includes the events up to `bounds[n + 1]` - 1, none of which is later than `times[n]`. ON comes first.
    `grown` float64 [2, H, W] is scratch memory and must be 0. O(N + output).
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
    """Fill `out` float32 [N, 1, side, side] with the time surface around each event, of its polarity and including it.

    If `out` is [N, 2, side, side], it gets the surfaces of both polarities, ON first. `grown` float64 and `epochs`
    int64, both [2, H + 2 radius, W + 2 radius], are scratch memory and must be 0. O(N side²).
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
    """Add the local memory time surfaces of the events of each cell to `out` float64 [cells, 2, side, side].

    `events` int64 [cells] gets the numbers of events. `sums` float64, `epochs` int64 and `members` int64, all [2, H,
    W], are scratch memory. Scratch memory and outputs must be 0 at the beginning. For each pixel, a sum of exponentials
    over its events of the last `window` µs is updated (see epochs.h), instead of summing these events again for each
    surface. So the cost is O(N side²). Events outside the sensor raise an IndexError.
    """
    _native.sum_surfaces(t, x, y, p, min(cell, 32_768), radius, window, tau, sums, epochs, members, out, events)
