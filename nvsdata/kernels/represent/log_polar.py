"""Counts of recent events around each event, by distance and direction."""

from __future__ import annotations

import numpy as np

from nvsdata.kernels import _native


def around_events(
    x: np.ndarray,
    y: np.ndarray,
    queue: int,
    dx: np.ndarray,
    dy: np.ndarray,
    weights: np.ndarray,
    count: np.ndarray,
    out: np.ndarray,
) -> None:
    """Put the weighted numbers of the events in the queue around each event into `out` float32 [N, bins], of sum 1.

    The queue has the `queue` latest events up to the event, itself included. `dx`, `dy` int64 [M] are offsets, and
    `weights` float32 [M, bins] what an event there adds; `count` int32 [H + 2 r, W + 2 r], r being the largest
    offset, is scratch, 0. O(N M), and the bins that an offset reaches. IndexError for events outside the sensor.
    """
    _native.around_events(x, y, queue, dx, dy, weights, count, out)
