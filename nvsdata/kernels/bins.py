"""Events summed into the cells of a grid in time and space."""

from __future__ import annotations

import numpy as np

from nvsdata.kernels.compiling import njit


@njit
def counted(x, y, p, bounds, out):
    """Add the events from `bounds[n]` to `bounds[n + 1]` to frame n of `out` [T, C, H, W]. O(N).

    With two channels, 1 to that of their polarity, ON first; with one, +1 or -1.
    """
    both = out.shape[1] == 2
    for n in range(bounds.size - 1):
        frame = out[n]
        for i in range(np.uint64(bounds[n]), np.uint64(bounds[n + 1])):
            channel = np.uint64(1 - p[i]) if both else np.uint64(0)
            step = np.float32(1) if both else np.float32(2) * p[i] - np.float32(1)
            frame[channel, np.uint64(y[i]), np.uint64(x[i])] += step


@njit
def marked(x, y, p, bounds, out):
    """Set `out` [T, 2, H, W] to 1 wherever a frame has events of a polarity, ON first. O(N)."""
    for n in range(bounds.size - 1):
        frame = out[n]
        for i in range(np.uint64(bounds[n]), np.uint64(bounds[n + 1])):
            frame[np.uint64(1 - p[i]), np.uint64(y[i]), np.uint64(x[i])] = 1


@njit
def spread(t, x, y, p, linear, out):
    """Add +1 or -1 for each event to `out` [B, H, W] at its time, scaled to 0 .. B - 1. O(N).

    If `linear`, it is divided between the two nearest bins; otherwise it goes to the nearest, of two the later one.
    """
    last = np.int64(out.shape[0] - 1)
    first, span = t[0], np.float64(t[t.size - 1] - t[0])
    for i in range(np.uint64(t.size)):
        at = np.float64(t[i] - first) * last / span if span else 0.0
        row, column = np.uint64(y[i]), np.uint64(x[i])
        step = np.float32(2) * p[i] - np.float32(1)
        if linear:
            bin = min(np.int64(at), last)
            share = np.float32(at - bin)
            out[np.uint64(bin), row, column] += step * (np.float32(1) - share)
            if bin < last:
                out[np.uint64(bin + 1), row, column] += step * share
        else:
            out[np.uint64(np.int64(at + 0.5)), row, column] += step
