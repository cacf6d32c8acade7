"""Layers of HOTS: each event gets the number of the prototype nearest to the time surface around it.

A recording must last less than 700 tau. Events outside the surfaces raise an IndexError.
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
    """Fill `out` float32 [M, F, side, side] with the surfaces of all features around the events `wanted`.

    `feature` int64 [N] has the feature of each event, and `wanted` int64 [M] sorted indices of events. `grown` float64
    [F, H + 2 radius, W + 2 radius] is scratch memory and must be 0. O(N + M F side²).
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
    """Write the number of the prototype nearest to each event to `found` int64 [N].

    `prototypes` is float32 [K, F, side, side], and `grown` is that of `feature_surfaces`. Scalar products are sums of
    16 float32 sums, so if the distances of two prototypes differ by less than about 1e-6, either may be found. O(N K F
    side²).
    """
    _native.nearest_prototypes(t, x, y, feature, tau, radius, prototypes, grown, found)
