"""Optical flow of events."""

from __future__ import annotations

import numpy as np

from nvsdata.kernels import _native


def plane_flow(
    t: np.ndarray,
    x: np.ndarray,
    y: np.ndarray,
    p: np.ndarray,
    radius: int,
    window: int,
    tolerance: float,
    least: int,
    latest: np.ndarray,
) -> np.ndarray:
    """Return the velocities of events in pixels per second, and 1 if valid or 0: float32 [N, 3]. O(N radius²).

    `latest` int64 [2, H + 2 radius, W + 2 radius] has the time of the last event of each pixel, OFF first, or
    `filters.NEVER` if there is none yet; margins must have none. It is updated. `window` and `tolerance` are in µs.
    Events outside raise an IndexError.
    """
    out = np.empty((t.size, 3), np.float32)
    _native.plane_flow(t, x, y, p, radius, window, tolerance, least, latest, out)
    return out
