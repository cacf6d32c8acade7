"""Windows of the columns of a store of the second layout, and small reads from open files (reading.cpp)."""

from __future__ import annotations

import numpy as np

from nvsdata.kernels import _native


def marked_range(marks: np.ndarray, base: int, start: int, stop: int) -> tuple[int, int]:
    """Return the first block that has events with start <= t < stop, and the one after the last such block.

    O(log blocks). `marks` uint32 or int64 has the first time of each block, to which `base` is added.
    """
    blocks: tuple[int, int] = _native.marked_range(marks, base, start, stop)
    return blocks


def stored_window(
    out_t: np.ndarray,
    out_x: np.ndarray,
    out_y: np.ndarray,
    out_p: np.ndarray,
    base: int,
    start: int,
    stop: int,
    t: np.ndarray,
    x: np.ndarray,
    y: np.ndarray,
    p: np.ndarray,
) -> int:
    """Copy the events with start <= t + base < stop from stored columns; return their number. O(log N + events found).

    `t` is uint32 or int64, `x` and `y` are uint8 or uint16, and `p` is uint8. They are written to `out_t` int64 (with
    `base` added), `out_x` and `out_y` int16 and `out_p` uint8, which must be at least as long.
    """
    count: int = _native.stored_window(out_t, out_x, out_y, out_p, base, start, stop, t, x, y, p)
    return count


def read_samples(handle: int, begin: int, step: int, out: np.ndarray) -> int:
    """Fill the rows of `out`, uint8 [N, size], with the bytes from `begin` on, one row every `step` bytes.

    Returns the number of rows that were filled before the end of the file: 0 on systems without `os.pread`.
    """
    count: int = _native.read_samples(handle, begin, step, out)
    return count
