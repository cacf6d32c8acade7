"""Windows of stored columns, and small reads from open files (reading.cpp)."""

from __future__ import annotations

import numpy as np

from nvsdata.kernels import _native


def marked_range(marks: np.ndarray, base: int, start: int, stop: int) -> tuple[int, int]:
    """Return the blocks that have events with start <= t < stop: the first one, and the one after the last.

    `marks` uint32 or int64: the blocks' first times, to which `base` is added. O(log blocks).
    """
    blocks: tuple[int, int] = _native.marked_range(marks, base, start, stop)
    return blocks


def read_window(
    out_t: np.ndarray,
    out_x: np.ndarray,
    out_y: np.ndarray,
    out_p: np.ndarray,
    base: int,
    start: int,
    stop: int,
    handle: int,
    lo: int,
    t0: int,
    x0: int,
    y0: int,
    p0: int,
    t_width: int,
    x_width: int,
    y_width: int,
) -> int:
    """Read events with start <= t + base < stop among lo, lo + 1, ... of an open file, as many as fit into the outputs.

    Args:
        out_t: int64, output.
        out_x: int16, output, like `out_y`.
        out_y: int16.
        out_p: uint8, output.
        base: added to stored times.
        start: see above.
        stop: see above.
        handle: the file.
        lo: number of the first event.
        t0: byte at which the times begin, as `x0`, `y0` and `p0` of the other columns.
        x0: see `t0`.
        y0: see `t0`.
        p0: see `t0`.
        t_width: bytes of a time: 4 for uint32, 8 for int64.
        x_width: bytes of a column: 1 for uint8, 2 for uint16, like `y_width`.
        y_width: see `x_width`.

    Returns:
        Number of events, or -1 if the file has fewer bytes than it took.
    """
    count: int = _native.read_window(
        out_t, out_x, out_y, out_p, base, start, stop, handle, lo, t0, x0, y0, p0, t_width, x_width, y_width
    )
    return count


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
    """Copy events of stored columns with start <= t + base < stop; return their number. O(log N + events found).

    `t` uint32 or int64, `x` and `y` uint8 or uint16, and `p` uint8 are written to `out_t` int64 (with `base` added),
    `out_x`, `out_y` int16 and `out_p` uint8, which must be at least as long.
    """
    count: int = _native.stored_window(out_t, out_x, out_y, out_p, base, start, stop, t, x, y, p)
    return count


def read_samples(handle: int, begin: int, step: int, out: np.ndarray) -> int:
    """Fill the rows of `out`, uint8 [N, size], with the bytes from `begin` on, one row every `step` bytes.

    Returns the number of rows that there were bytes for: 0 on systems without `os.pread`.
    """
    count: int = _native.read_samples(handle, begin, step, out)
    return count
