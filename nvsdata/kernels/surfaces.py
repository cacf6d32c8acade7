"""Time surfaces: how long ago pixels had their last event, as exponentials.

A value is kept as exp((t - begin) / tau), where `begin` is that of the event's epoch, so that a later look at it costs
a product, no exponential. An epoch lasts EPOCH tau, in whole µs; what is older than the last epoch counts as nothing.
"""

from __future__ import annotations

import numpy as np

from nvsdata.kernels.compiling import njit

EPOCH = 300  # exp(300) fits float64, and so does its product with exp(-300)
TABLE = 64  # µs between events up to which the exponential is looked up


@njit
def surfaces(t, x, y, p, times, bounds, tau, grown, out):
    """Fill `out` [T, 2, H, W] with exp(-(times[n] - t) / tau) of each pixel's and polarity's last event, ON first.

    Frame n knows the events up to `bounds[n + 1]`, none later than `times[n]`. `grown` float64 [2, H, W] is scratch,
    0. O(N + output).
    """
    steps = np.exp(np.arange(TABLE) / tau)
    # values grow from this moment on
    begin = times[0]
    for n in range(times.size):
        if times[n] - begin > 100 * tau:
            grown *= np.exp((begin - times[n]) / tau)
            begin = times[n]
        value, since = 0.0, np.int64(0)
        for i in range(np.uint64(bounds[n]), np.uint64(bounds[n + 1])):
            gap = t[i] - since
            if value > 1e-200 and gap < TABLE:
                value *= steps[np.uint64(gap)]
            else:
                value = np.exp((t[i] - begin) / tau)
            since = t[i]
            grown[np.uint64(1 - p[i]), np.uint64(y[i]), np.uint64(x[i])] = value
        shrink = np.exp((begin - times[n]) / tau)
        flat, frame = grown.ravel(), out[n].ravel()
        for q in range(np.uint64(flat.size)):
            frame[q] = flat[q] * shrink


@njit
def epoch_of(tau):
    """Length of an epoch in µs, int64: whole numbers, so that times within it are exact however late."""
    return np.int64(min(np.ceil(EPOCH * tau), 2.0**62))


@njit
def event_surfaces(t, x, y, p, tau, radius, grown, epochs, out):
    """Fill `out` [N, 1, side, side] with the surface of each event's polarity around it, itself included.

    With `out` [N, 2, side, side], the surfaces of both polarities, ON first.

    `grown` float64 and `epochs` int64, both [2, H + 2 radius, W + 2 radius], are scratch, 0. O(N side²).
    """
    side = np.uint64(2 * radius + 1)
    length, both = epoch_of(tau), out.shape[1] == 2
    old = np.exp(-length / tau)
    for i in range(np.uint64(t.size)):
        # from 1 on, because 0 is that of no event
        epoch = (t[i] - t[0]) // length + 1
        value = np.exp((t[i] - t[0] - (epoch - 1) * length) / tau)
        channel, row, column = np.uint64(1 - p[i]), np.uint64(y[i]), np.uint64(x[i])
        middle = np.uint64(radius)
        grown[channel, row + middle, column + middle], epochs[channel, row + middle, column + middle] = value, epoch
        shrink = 1 / value
        for k in range(np.uint64(out.shape[1])):
            source = k if both else channel
            for r in range(side):
                for c in range(side):
                    age = epoch - epochs[source, row + r, column + c]
                    factor = shrink if age == 0 else shrink * old if age == 1 else 0.0
                    out[i, k, r, c] = grown[source, row + r, column + c] * factor
