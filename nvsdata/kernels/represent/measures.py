"""Statistics of the events of each pixel, and sums in patches of pixels.

Events outside the images raise an IndexError.
"""

from __future__ import annotations

import numpy as np

from nvsdata.kernels import _native

COUNT, POLARITY, TIME = 0, 1, 2
SUM, MEAN, MAX, VARIANCE = 0, 1, 2, 3


def measured(
    t: np.ndarray,
    x: np.ndarray,
    y: np.ndarray,
    p: np.ndarray,
    start: int,
    span: int,
    first: int,
    last: int,
    wanted: int,
    quantity: int,
    measure: int,
    scratch: np.ndarray,
    out: np.ndarray,
) -> None:
    """Write a statistic of the events of each pixel to `out` float32 [H, W]; 0 for pixels without events. O(N).

    Events `first` to `last` - 1 of polarity `wanted` count (-1: both polarities). `measure` is one of SUM, MEAN, MAX
    and VARIANCE. `quantity` is one of COUNT (1 per event), POLARITY (±1) and TIME (since `start`, as a fraction of
    `span`). `scratch` is float64 [3, H, W].
    """
    _native.measured(t, x, y, p, start, span, first, last, wanted, quantity, measure, scratch, out)


def tokens(
    t: np.ndarray, x: np.ndarray, y: np.ndarray, p: np.ndarray, bounds: np.ndarray, patch: int, out: np.ndarray
) -> None:
    """Add the numbers of events, and the sums of their times from 0 to 1, to `out`. O(N).

    `out` is float32 [K, 2, 2, patch², H', W']. Its axes are the part of the time (from event `bounds[k]` up to event
    `bounds[k + 1]`), the polarity (OFF first), number or sum of times, the position in the patch, and row and column of
    the patch.
    """
    _native.tokens(t, x, y, p, bounds, patch, out)
