"""Events summed into the cells of a grid in time and space.

Frame n has the events from `bounds[n]` to `bounds[n + 1]` - 1. Events outside the frames raise an IndexError.
"""

from __future__ import annotations

import numpy as np

from nvsdata.kernels import _native

LARGEST = 32_768  # pixels along an axis: a cell of as many is the sensor


def sum_frames(
    x: np.ndarray,
    y: np.ndarray,
    p: np.ndarray,
    bounds: np.ndarray,
    sensor_size: tuple[int, int],
    factor: int,
    out: np.ndarray,
) -> None:
    """Write the sum of polarity (+1 or -1) at each pixel, averaged over cells of `factor` x `factor` pixels, to `out`.

    `out` float32 [frames, rows, columns] must be 0. O(N + output).
    """
    _native.sum_frames(x, y, p, bounds, *sensor_size, min(factor, LARGEST), out)


def counted(x: np.ndarray, y: np.ndarray, p: np.ndarray, bounds: np.ndarray, out: np.ndarray) -> None:
    """Add events to frames, `out` float32, uint8 or int16 [T, C, H, W]; integers are clipped to their range. O(N).

    With two channels (ON first), each event adds 1 to the channel of its polarity. With one channel, it adds +1 or -1.
    """
    _native.counted(x, y, p, bounds, out)


def counted_by_polarity(x: np.ndarray, y: np.ndarray, p: np.ndarray, bounds: np.ndarray, out: np.ndarray) -> None:
    """Add 1 for each event to `out` float32 [2, T, H, W], OFF first. O(N)."""
    _native.counted_by_polarity(x, y, p, bounds, out)


def marked(x: np.ndarray, y: np.ndarray, p: np.ndarray, bounds: np.ndarray, out: np.ndarray) -> None:
    """Set `out` float32, uint8 or int16 [T, 2, H, W] to 1 wherever a frame has events of a polarity, ON first. O(N)."""
    _native.marked(x, y, p, bounds, out)


def spread(t: np.ndarray, x: np.ndarray, y: np.ndarray, p: np.ndarray, linear: bool, out: np.ndarray) -> None:
    """Add +1 or -1 for each event to `out` float32 [B, H, W] at its time, scaled to 0 .. B - 1. O(N).

    If `linear`, an event is divided between the two nearest bins. Otherwise it is added to the nearest bin, or to the
    later one of two that are equally near.
    """
    _native.spread(t, x, y, p, linear, out)
