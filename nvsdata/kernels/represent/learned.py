"""Sums of a piecewise linear function of the times of events. Events outside the images raise an IndexError."""

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

    s is the time of the event, from 0 at the first event of its sample to 1 at the last. The function f is piecewise
    linear: f(u) = line[piece, 0] + line[piece, 1] u, with `line` float64 [P, 2]. `ends` float64 [P] has the ends of the
    pieces, and the last one is infinite. `nearby` int32 has the piece with which the search begins, for equally spaced
    u from -1 to 1. Sample b has events offsets[b] to offsets[b + 1] - 1. `out` is float32 [B, 2, C, H, W].
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
    """Add the gradient of `splat` with respect to `line` to `gradient` float64 [P, 2].

    `wanted` is the gradient with respect to `out`.
    """
    _native.splat_gradient(t, x, y, p, offsets, ends, nearby, wanted, gradient)
