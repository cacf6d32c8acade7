"""Summing events to frames."""

from __future__ import annotations

import numpy as np

from nvsdata.kernels.compiling import njit


@njit
def sum_frames(x, y, p, bounds, sensor_size, factor, out):
    """Put polarity, +1 or -1, summed at each pixel, and its mean over cells, into `out` [frames, H, W]. O(N + output).

    Frame n has the events from `bounds[n]` to `bounds[n + 1]`; `out` float32 is 0.
    """
    width, height = sensor_size
    _, rows, columns = out.shape
    for n in range(bounds.size - 1):
        for i in range(np.uint64(bounds[n]), np.uint64(bounds[n + 1])):
            out[n, y[i] // factor, x[i] // factor] += np.float32(2) * p[i] - np.float32(1)
        if factor > 1:
            for r in range(rows):
                tall = min(factor, height - r * factor)
                for c in range(columns):
                    out[n, r, c] /= np.float32(tall * min(factor, width - c * factor))
