"""Layers of HOTS: each event becomes the number of the prototype that the time surface around it is nearest to.

A value of a surface is kept as exp((t - t_0) / tau), so that a later look at it costs a product: a recording must last
less than 700 tau.
"""

from __future__ import annotations

import numpy as np

from nvsdata.kernels.compiling import njit


@njit
def feature_surfaces(t, x, y, feature, tau, radius, wanted, grown, out):
    """Fill `out` float32 [M, F, side, side] with the surfaces of all features around the events `wanted`, sorted.

    `grown` float64 [F, H + 2 radius, W + 2 radius] is scratch, 0. O(N + M F side²).
    """
    side, m = 2 * radius + 1, 0
    for i in range(t.size):
        value = np.exp((t[i] - t[0]) / tau)
        grown[feature[i], y[i] + radius, x[i] + radius] = value
        if m < wanted.size and wanted[m] == i:
            out[m] = grown[:, y[i] : y[i] + side, x[i] : x[i] + side] / value
            m += 1


@njit
def nearest_prototypes(t, x, y, feature, tau, radius, prototypes, grown, found):
    """Write the number of each event's nearest prototype, float32 [K, F, side, side], to `found` int64 [N].

    `grown` as in `feature_surfaces`. O(N K F side²).
    """
    side = 2 * radius + 1
    count, features = prototypes.shape[0], prototypes.shape[1]
    squares = (prototypes.reshape(count, -1) ** 2).sum(1)
    surface = np.empty((features, side, side), np.float32)
    for i in range(t.size):
        value = np.exp((t[i] - t[0]) / tau)
        grown[feature[i], y[i] + radius, x[i] + radius] = value
        shrink = 1 / value
        for f in range(features):
            for r in range(side):
                for c in range(side):
                    surface[f, r, c] = grown[f, y[i] + r, x[i] + c] * shrink
        flat, best = surface.ravel(), np.inf
        for k in range(count):
            # the surface's own square is the same for all
            distance = squares[k] - 2 * np.dot(prototypes[k].ravel(), flat)
            if distance < best:
                best, found[i] = distance, k
