"""Lines of decimal numbers to event columns."""

from __future__ import annotations

import numpy as np

from nvsdata.kernels import _native

# Faults of a line
OK, BAD_NUMBER, BAD_COUNT, OUT_OF_RANGE, TOO_LATE = 0, 1, 2, 3, 4


def text_decode(
    raw: np.ndarray, seconds_first: bool, skip_faults: bool, *columns: np.ndarray
) -> tuple[int, int, int, int]:
    """Parse lines of four numbers. O(bytes).

    Args:
        raw: uint8 [N].
        seconds_first: a line is `t x y p` with t in seconds (kept exact: digits, not floats, rounded down to the µs);
            otherwise `x y t p`, all integers, t in µs. Empty lines and lines that begin with `#` are skipped.
        skip_faults: drop faulty lines; otherwise the first one ends the parsing.
        columns: t int64, x, y int16, p uint8, to be filled, with room for an event per line.

    Returns:
        (events, fault code, byte of the fault, lines dropped).
    """
    result: tuple[int, int, int, int] = _native.text_decode(raw, seconds_first, skip_faults, *columns)
    return result
