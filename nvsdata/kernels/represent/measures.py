"""Measures of each pixel's events, and sums in patches of pixels. IndexError for events outside of them."""

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
    """Put a measure of each pixel's events from `first` to `last` into `out` float32 [H, W], 0 without events. O(N).

    `wanted`: their polarity, -1 for any. `quantity`: 1, ±1 or the time from `start` as a fraction of `span`. `scratch`
    is float64 [3, H, W].
    """
    _native.measured(t, x, y, p, start, span, first, last, wanted, quantity, measure, scratch, out)


def tokens(
    t: np.ndarray, x: np.ndarray, y: np.ndarray, p: np.ndarray, bounds: np.ndarray, patch: int, out: np.ndarray
) -> None:
    """Add events to `out` [K, 2, 2, patch², H', W']: their number, and the sum of their times from 0 to 1. O(N).

    Axes of `out`, float32: part of the time, from `bounds[part]` to `bounds[part + 1]`, polarity (OFF first), which of
    both, place in the patch, patch.
    """
    _native.tokens(t, x, y, p, bounds, patch, out)
