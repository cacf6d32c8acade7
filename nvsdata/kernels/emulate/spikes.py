"""From a frame's keys to events: sorted, unpacked, read out.

A key: µs since the last frame << 32 | y << 17 | x << 1 | ON. A frame's keys are in raster order until they are sorted.
"""

from __future__ import annotations

import numpy as np

from nvsdata.kernels import _native


def read(keys: np.ndarray, bits: int, start: int, t: np.ndarray, x: np.ndarray, y: np.ndarray, p: np.ndarray) -> None:
    """Unpack keys into columns of events; if `bits` > 0, sort them first by their times below 2^bits, in place."""
    _native.read_keys(keys, bits, start, t, x, y, p)


def read_out(
    t: np.ndarray,
    x: np.ndarray,
    y: np.ndarray,
    width: int,
    ready: np.ndarray,
    refractory: int,
    gap: float,
    busy: float,
    start: int,
) -> tuple[np.ndarray, np.ndarray, float]:
    """Times at which events leave a sensor that reads out one per `gap` µs, and which of them do. O(N).

    The readout is occupied until `start` + `busy`; the new `busy` is returned. A pixel is blind while its
    event waits and for `refractory` µs after: `ready` int64 [H * W] has the time in µs at which it sees again.

    Raises:
        IndexError: an event lies outside the sensor.
    """
    out, kept = np.empty_like(t), np.empty(t.size, np.bool_)
    busy = _native.read_out(t, x, y, width, ready, int(refractory), gap, busy, start, out, kept)
    return out, kept, busy
