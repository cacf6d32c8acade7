"""Small loops over the edges of a graph."""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True, nogil=True)
def pseudo_coordinates(pos, edges, reach):
    """min(|dx| / reach[0], 1) and the same along y for every edge: float32 [E, 2]. O(E)."""
    out = np.empty((edges.shape[1], 2), np.float32)
    for e in range(edges.shape[1]):
        i = edges[0, e]
        j = edges[1, e]
        out[e, 0] = min(abs(pos[i, 0] - pos[j, 0]) / reach[0], np.float32(1))
        out[e, 1] = min(abs(pos[i, 1] - pos[j, 1]) / reach[1], np.float32(1))
    return out


@njit(cache=True, nogil=True)
def is_sorted(values):
    """Whether the values never decrease. O(N)."""
    for i in range(1, values.size):
        if values[i] < values[i - 1]:
            return False
    return True
