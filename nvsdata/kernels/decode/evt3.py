"""Conversion of Prophesee EVT3 words, 16 bits each, to event columns and back; see `kernels.decode.evt`.

Bits 12 to 15 of a word are its type. Row, column, the high 12 bits and the low 12 bits of the time are in separate
words. After a word with a base column, each vector word is a mask of the next 12 or 8 columns. `state` int64 [5] has
the high part of the time in µs, the low part, y, base x and polarity.
"""

from __future__ import annotations

import numpy as np

from nvsdata.kernels import _native
from nvsdata.kernels.decode.evt import count_shown, find_triggers


def evt3_walk(
    raw: np.ndarray, block: int, state: np.ndarray, seen: np.ndarray, states: np.ndarray, times: np.ndarray
) -> None:
    """Walk over a piece of the words, uint8 [N], as `evt2_walk` does, with states int64 [M, 5]. O(N)."""
    _native.evt3_walk(raw, block, state, seen, states, times)


def evt3_count(raw: np.ndarray) -> int:
    """Return the number of events in a piece of the words, including those before the first time. O(N)."""
    count: int = _native.evt3_count(raw)
    return count


def evt3_decode(
    raw: np.ndarray, width: int, height: int, state: np.ndarray, seen: np.ndarray, kept: int, *columns: np.ndarray
) -> tuple[int, int]:
    """Decode a piece of the words. O(N + events). ValueError if there isn't room for one more event."""
    found: tuple[int, int] = _native.evt3_decode(raw, width, height, state, seen, kept, *columns)
    return found


def evt3_triggers(raw: np.ndarray, state: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return times in µs, channels and levels of the external triggers in a piece of the words; updates `state`."""
    return find_triggers(_native.evt3_triggers, _native.evt3_count_triggers, raw, state)


def evt3_encode(t: np.ndarray, x: np.ndarray, y: np.ndarray, p: np.ndarray, state: np.ndarray) -> np.ndarray:
    """Encode sorted events as EVT3 words, uint16. O(N).

    `state` int64 [3] has the high part and low part of the time and the row that were written last, or -1 each.
    """
    # at most a low part, a row and one word for each event
    words = np.empty(3 * t.size + count_shown(t, int(state[0]), 12, 12), np.uint16)
    return words[: _native.evt3_encode(t, x, y, p, state, words)]
