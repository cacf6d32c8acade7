"""Layers of HOTS: each event becomes the number of the prototype that the time surface around it is nearest to.

A recording must last less than 700 tau. IndexError for events outside of the surfaces.
"""

from __future__ import annotations

import numpy as np

from nvsdata.kernels import _native


def feature_surfaces(
    t: np.ndarray,
    x: np.ndarray,
    y: np.ndarray,
    feature: np.ndarray,
    tau: float,
    radius: int,
    wanted: np.ndarray,
    grown: np.ndarray,
    out: np.ndarray,
) -> None:
    """Fill `out` float32 [M, F, side, side] with the surfaces of all features around the events `wanted`, sorted.

    `feature` and `wanted` are int64; `grown` float64 [F, H + 2 radius, W + 2 radius] is scratch, 0. O(N + M F side²).
    """
    _native.feature_surfaces(t, x, y, feature, tau, radius, wanted, grown, out)


def nearest_prototypes(
    t: np.ndarray,
    x: np.ndarray,
    y: np.ndarray,
    feature: np.ndarray,
    tau: float,
    radius: int,
    prototypes: np.ndarray,
    grown: np.ndarray,
    found: np.ndarray,
) -> None:
    """Write the number of each event's nearest prototype, float32 [K, F, side, side], to `found` int64 [N].

    `grown` as in `feature_surfaces`. Products are sums of 16 float32 sums, so if two prototypes are equally near
    up to about 1e-6, either may be found. O(N K F side²).
    """
    _native.nearest_prototypes(t, x, y, feature, tau, radius, prototypes, grown, found)
