"""Conversion of lines of decimal numbers to event columns."""

from __future__ import annotations

import numpy as np

from nvsdata.kernels import _native

# Faults of a line
OK, BAD_NUMBER, BAD_COUNT, OUT_OF_RANGE, TOO_LATE = 0, 1, 2, 3, 4


def text_decode(
    raw: np.ndarray, order: str, seconds: bool, skip_faults: bool, *columns: np.ndarray
) -> tuple[int, int, int, int]:
    """Parse lines of four numbers. O(bytes).

    Args:
        raw: Bytes of the text, uint8 [N]. Empty lines and lines that begin with `#` or `%` are skipped. Spaces, tabs,
            commas and semicolons are between numbers.
        order: What the numbers of a line are, such as "xytp".
        seconds: True if times are in seconds; their digits are converted to µs exactly and rounded down. False if they
            are whole numbers in µs, like all other numbers.
        skip_faults: True to drop faulty lines. Otherwise the first faulty line ends the parsing.
        columns: Outputs t int64, x and y int16, and p uint8, with room for an event per line.

    Returns:
        Number of events, fault code, byte of the fault, and number of dropped lines.
    """
    at = (order.index(name) for name in "txyp")
    result: tuple[int, int, int, int] = _native.text_decode(raw, *at, seconds, skip_faults, *columns)
    return result
