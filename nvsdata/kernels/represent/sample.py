"""Non-uniform grid sampling."""

from __future__ import annotations

import numpy as np

from nvsdata.kernels import _native


def nonuniform_sample(
    t: np.ndarray, x: np.ndarray, y: np.ndarray, k: int, wx: float, wt: float, seed: int
) -> np.ndarray:
    """Return the indices (sorted, int64) of one random event from each box of at most `k` events.

    The space-time box of all events is split at the median of its widest side (x and y weighted
    by `wx`, t by `wt`; ties by index) until each box contains at most k events. `t` must not decrease.
    O(N log(N / k)).
    """
    chosen = np.zeros(t.size, np.bool_)
    _native.nonuniform_sample(t, x, y, min(k, t.size + 1), wx, wt, seed, chosen)
    return chosen.nonzero()[0]
