"""Steps that both emulators share: tiles that changed, the logarithm of brightness, and events from a frame's keys.

The key of an event is: µs since the previous frame << 32 | y << 17 | x << 1 | ON. The keys of a frame are in raster
order until they are sorted. The C++ files are tiles.cpp, brightness.cpp and spikes.cpp.
"""

from __future__ import annotations

import numpy as np

from nvsdata.kernels import _native

TILE = (8, 64)  # rows, columns: 64 pixels of 3 bytes are three cache lines


def find_dirty(frame: np.ndarray, previous: np.ndarray, tile_bytes: int, dirty: np.ndarray) -> int:
    """Mark the tiles that differ from those of the `previous` frame; return their number. O(bytes).

    Frames are uint8 [H, bytes of a row], `dirty` is bool [tile rows, tile columns].
    """
    count: int = _native.find_dirty(frame, previous, tile_bytes, dirty)
    return count


def logarithm(thousandths: np.ndarray, t_log: float, slope: float, out: np.ndarray) -> None:
    """Write the logarithm of brightness q (thesis, eq. 3.1) to `out`: ln q if q > t_log, otherwise slope q.

    `thousandths` int32 or float32 has q in thousandths; `out` is float32. The error is at most 4e-7. The result is the
    same on every machine.
    """
    _native.logarithm(thousandths, t_log, slope, out)


def read_keys(
    keys: np.ndarray, bits: int, start: int, t: np.ndarray, x: np.ndarray, y: np.ndarray, p: np.ndarray
) -> None:
    """Unpack keys into columns of events; if `bits` > 0, first sort the keys in place by their times below 2^bits."""
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
    """Return the times at which a sensor with a slow readout outputs events, and a mask of these events. O(N).

    The readout takes `gap` µs per event and is occupied until `start` + `busy`; the new `busy` is also returned. A
    pixel can't fire while its event waits and for `refractory` µs afterwards: `ready` int64 [H * W] has the time in µs
    from which it can fire again.

    Raises:
        IndexError: An event is outside the sensor.
    """
    out, kept = np.empty_like(t), np.empty(t.size, np.bool_)
    busy = _native.read_out(t, x, y, width, ready, int(refractory), gap, busy, start, out, kept)
    return out, kept, busy
