"""The nearest events of each event, in space and time."""

from __future__ import annotations

import numpy as np

from nvsdata.kernels import _native

SWEEP: int = _native.SWEEP  # mean number of events near in time up to which testing all of them is fastest


def near_sources(
    t: np.ndarray,
    x: np.ndarray,
    y: np.ndarray,
    radius: float,
    alpha: float,
    beta: float,
    k: int,
    sweep_below: int = SWEEP,
) -> tuple[np.ndarray, np.ndarray, int]:
    """Find the `k` nearest other events within `radius` of each event.

    The squared distance is alpha (dx² + dy²) + beta dt². Of events at the same distance, the one nearer in time comes
    first, then the one of smaller index, as in the author's released graphs.

    The search visits pixels around an event in order of distance. It takes O(N (P + k)), where P is the number of
    pixels up to the distance of the k-th neighbor, if no difference in time can change the order of distances in space,
    and O(N (P + k²)) otherwise. If on average at most `sweep_below` events are near in time (in the second case, three
    times as many), all of these are tested instead.

    Args:
        t: Times in µs, int64 [N], which must not decrease.
        x: Columns, int16 or int32 [N].
        y: Rows, of the same type as `x`.
        radius: Largest distance. It may be infinite if alpha > 0.
        alpha: Weight of squared pixels.
        beta: Weight of squared µs.
        k: Largest number of neighbors, at least 1.
        sweep_below: Mean number of earlier events near in time up to which all of them are tested. 0 always selects the
            search by pixels, and a very large number never.

    Returns:
        Number of sources of each event, int32 [N]; their indices, ascending, at the beginning of each row of an int32
        [N, min(k, N - 1) + 1]; and the number of all edges.
    """
    k = max(min(k, t.size - 1), 1)
    degree = np.zeros(t.size, np.int32)
    source = np.empty((t.size, k + 1), np.int32)
    return degree, source, _native.near_sources(t, x, y, radius, alpha, beta, sweep_below, degree, source)


def near_edges(
    t: np.ndarray,
    x: np.ndarray,
    y: np.ndarray,
    radius: float,
    alpha: float,
    beta: float,
    k: int,
    sweep_below: int = SWEEP,
) -> np.ndarray:
    """Return the edges to each event from its `near_sources`: int64 [2, E], sorted by (target, source)."""
    degree, source, count = near_sources(t, x, y, radius, alpha, beta, k, sweep_below)
    edges = np.empty((2, count), np.int64)
    # a call takes a fifth of the time of a graph of one event
    if count:
        _native.listed_edges(degree, source, edges)
    return edges
