"""Time surfaces: how long ago pixels had their last event, as exponentials. IndexError for events outside of them."""

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

    Frame n knows the events up to `bounds[n + 1]`, none later than `times[n]`. `grown` float64 [2, H, W] is scratch,
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
