"""Records of ATIS cameras to event columns and back.

A decoder takes `raw`, uint8, some records of a file, and the `state` before them, which it updates to the state after
them. It fills `t`, `x`, `y`, `p` (int64 µs, int16, int16, uint8) from index `kept` on, where there is room for one
event per record, and returns `(count, bad)`: the number of events, and the index of the first record
whose coordinates lie outside the sensor (-1 if none). A sensor of unknown size is larger than any place.
"""

from __future__ import annotations

import numpy as np

from nvsdata.kernels import _native

ATIS_OVERFLOW_Y = 240
ATIS_OVERFLOW_US = 1 << 13
FULL_US = 1 << 23  # a record's own time is below it

# The state of a walk over an ATIS file: µs of overflow in force; times of the last and the first event; the number of
# times that fell; the size of the sensor that the events need; the numbers of overflow records, of all records, and of
# damaged ones, whose y no camera writes; the index of the first damaged one
OVERFLOW, ATIS_LAST, ATIS_FIRST, FALLS, RIGHT, BOTTOM, MARKERS, RECORDS, DAMAGED, DAMAGE = range(10)
ATIS_BEGUN = (0, 0, 0, 0, 1, 1, 0, 0, 0, -1)


def atis_walk(raw: np.ndarray, block: int, state: np.ndarray, times: np.ndarray, offsets: np.ndarray) -> None:
    """Walk over a piece of ATIS records, and update the `state` before them to the state after them. O(N).

    Writes the unwrapped time of every `block`-th record of the file and the µs of overflow in force there, into
    `times` int64 [M] and `offsets` int64 [M, 1].
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

    `state` int64 [4]: µs of overflow in force, the numbers of records and of damaged records so far, and the index
    of the first damaged one. Damaged records are left out.
    """
    found: tuple[int, int] = _native.atis_decode(raw, width, height, state, kept, t, x, y, p)
    return found


def atis_encode(t: np.ndarray, x: np.ndarray, y: np.ndarray, p: np.ndarray, offset: int) -> tuple[np.ndarray, int]:
    """Return ATIS bytes of sorted events, with overflow markers as late as possible. O(N + markers).

    `offset`: µs of the markers written before; its new value is also returned.
    """
    markers = max((int(t[-1]) - offset - FULL_US) // ATIS_OVERFLOW_US + 1, 0) if t.size else 0
    raw = np.empty(5 * (t.size + markers), np.uint8)
    return raw, _native.atis_encode(t, x, y, p, offset, raw)
