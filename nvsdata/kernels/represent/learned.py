"""Sums of a piecewise linear function of the events' times. IndexError for events outside of the images."""

from __future__ import annotations

import numpy as np

from nvsdata.kernels import _native


def splat(
    t: np.ndarray,
    x: np.ndarray,
    y: np.ndarray,
    p: np.ndarray,
    offsets: np.ndarray,
    ends: np.ndarray,
    nearby: np.ndarray,
    line: np.ndarray,
    out: np.ndarray,
) -> None:
    """Add s f(s - c / (C - 1)) of each event to channel c of its pixel and polarity, OFF first. O(N C).

    `out` float32 [B, 2, C, H, W]; s goes from 0 at a sample's first event to 1 at its last, f(u) = line[piece, 0] +
    line[piece, 1] u, with `line` float64 [P, 2]. `ends` float64 [P] are where pieces end, the last one infinite;
    `nearby` int32 has the piece to begin at for equally spaced u from -1 to 1. `offsets` int64 [B + 1].
    """
    _native.splat(t, x, y, p, offsets, ends, nearby, line, out)


def splat_gradient(
    t: np.ndarray,
    x: np.ndarray,
    y: np.ndarray,
    p: np.ndarray,
    offsets: np.ndarray,
    ends: np.ndarray,
    nearby: np.ndarray,
    wanted: np.ndarray,
    gradient: np.ndarray,
) -> None:
    """Add the gradient of `splat` with respect to `line` to `gradient` float64 [P, 2], from `wanted`, that of `out`."""
    _native.splat_gradient(t, x, y, p, offsets, ends, nearby, wanted, gradient)
