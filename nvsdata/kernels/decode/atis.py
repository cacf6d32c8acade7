"""Conversion of records of ATIS cameras to event columns and back.

Each decoder has the following arguments and results. `raw` uint8 contains records of a file. `state` is the state
before these records, and is updated to the state after them. The columns `t`, `x`, `y` and `p` (int64 µs, int16, int16,
uint8) are filled from index `kept` on; they need room for one event per record. The result `(count, bad)` is the number
of events and the index of the first record with coordinates outside the sensor (-1 if there is none). If the size of
the sensor is unknown, pass one that is larger than any coordinate.
"""

from __future__ import annotations

import numpy as np

from nvsdata.kernels import _native

ATIS_OVERFLOW_Y = 240
ATIS_OVERFLOW_US = 1 << 13
FULL_US = 1 << 23  # the time in a record is below it

# The state of a walk over an ATIS file: sum of the overflow records so far in µs; times of the last and the first
# event; number of decreases of time; width and height of the smallest sensor that contains the events; numbers of
# overflow records, of all records, and of damaged ones (with an impossible y); index of the first damaged
# record
OVERFLOW, ATIS_LAST, ATIS_FIRST, FALLS, RIGHT, BOTTOM, MARKERS, RECORDS, DAMAGED, DAMAGE = range(10)
ATIS_BEGUN = (0, 0, 0, 0, 1, 1, 0, 0, 0, -1)


def atis_walk(raw: np.ndarray, block: int, state: np.ndarray, times: np.ndarray, offsets: np.ndarray) -> None:
    """Walk over a piece of ATIS records, and update the `state` before them to the state after them. O(N).

    For every `block`-th record of the file, its unwrapped time is written to `times` int64 [M], and the sum of the
    overflow records before it, in µs, to `offsets` int64 [M, 1].
    """
    _native.atis_walk(raw, block, state, times, offsets)


def atis_decode(
    raw: np.ndarray,
    width: int,
    height: int,
    state: np.ndarray,
    kept: int,
    t: np.ndarray,
    x: np.ndarray,
    y: np.ndarray,
    p: np.ndarray,
) -> tuple[int, int]:
    """Decode a piece of ATIS records. O(N).

    `state` int64 [4] has the sum of the overflow records so far in µs, the numbers of records and of damaged records so
    far, and the index of the first damaged record. Damaged records are left out.
    """
    found: tuple[int, int] = _native.atis_decode(raw, width, height, state, kept, t, x, y, p)
    return found


def atis_encode(t: np.ndarray, x: np.ndarray, y: np.ndarray, p: np.ndarray, offset: int) -> tuple[np.ndarray, int]:
    """Return ATIS bytes of sorted events, with overflow markers as late as possible. O(N + markers).

    `offset` is the sum of the markers written before, in µs. Its new value is also returned.
    """
    markers = max((int(t[-1]) - offset - FULL_US) // ATIS_OVERFLOW_US + 1, 0) if t.size else 0
    raw = np.empty(5 * (t.size + markers), np.uint8)
    return raw, _native.atis_encode(t, x, y, p, offset, raw)
