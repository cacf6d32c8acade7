"""Sums of a piecewise linear function of the events' times."""

from __future__ import annotations

import numpy as np

from nvsdata.kernels.compiling import njit


@njit(inline="always")
def _piece(tau, ends, nearby):
    """Number of the piece that `tau` in [-1, 1] lies in; `ends` are where pieces end, `nearby` where to begin."""
    piece = np.uint64(nearby[np.uint64((tau + 1) * (0.5 * (nearby.size - 1)))])
    while tau > ends[piece]:
        piece += np.uint64(1)
    return piece


@njit(inline="always")
def _through(t, x, y, p, offsets, ends, nearby, line, image, backwards):
    """Every event and channel: from `line` to `image` or, `backwards`, from `image` to the gradient `line`."""
    bins = image.shape[2]
    step = 1 / np.float64(max(bins - 1, 1))
    for b in range(offsets.size - 1):
        first, last = np.uint64(offsets[b]), np.uint64(offsets[b + 1])
        if first == last:
            continue
        span = np.float64(max(t[last - np.uint64(1)] - t[first], 1))
        for i in range(first, last):
            s = np.float64(t[i] - t[first]) / span
            row, column, channel = np.uint64(y[i]), np.uint64(x[i]), np.uint64(p[i])
            for c in range(np.uint64(bins)):
                tau = s - c * step
                piece = _piece(tau, ends, nearby)
                if backwards:
                    share = s * np.float64(image[b, channel, c, row, column])
                    line[piece, 0] += share
                    line[piece, 1] += share * tau
                else:
                    value = s * (line[piece, 0] + line[piece, 1] * tau)
                    image[b, channel, c, row, column] += np.float32(value)


@njit
def splat(t, x, y, p, offsets, ends, nearby, line, out):
    """Add s f(s - c / (C - 1)) of each event to channel c of its pixel and polarity, OFF first. O(N C).

    `out` float32 [B, 2, C, H, W]; s goes from 0 at a sample's first event to 1 at its last, f(u) = line[piece, 0] +
    line[piece, 1] u, with `line` float64 [P, 2].
    """
    _through(t, x, y, p, offsets, ends, nearby, line, out, False)


@njit
def splat_gradient(t, x, y, p, offsets, ends, nearby, wanted, gradient):
    """Add the gradient of `splat` with respect to `line` to `gradient` float64 [P, 2], from `wanted`, that of `out`."""
    _through(t, x, y, p, offsets, ends, nearby, gradient, wanted, True)
