"""Conversion of Prophesee EVT2 and EVT 2.1 words to event columns and back; see `kernels.decode.evt`.

An EVT2 word has 32 bits; its type is in bits 28 to 31. An event word has the low 6 bits of the time in bits 22 to 27, x
in bits 11 to 21 and y in bits 0 to 10. A time word has the high 28 bits of the time. An EVT 2.1 word has 64 bits. Its
lower half is an EVT2 word. Its upper half is a mask of the 32 pixels from x on: each pixel that is set has such an
event. (If a camera writes the halves in the other order, they are exchanged first.) `state` int64 [1] contains the high
part of the time.
"""

from __future__ import annotations

import numpy as np

from nvsdata.kernels import _native
from nvsdata.kernels.decode.evt import count_shown, find_triggers


def evt2_walk(
    raw: np.ndarray, block: int, state: np.ndarray, seen: np.ndarray, states: np.ndarray, times: np.ndarray
) -> None:
    """Walk over a piece of the words, uint8 [N], which begins with a block, in O(N).

    For every `block`-th word it writes

    - the state before this word (int64 [M, 1]),
    - the time of the last event before this word (int64 [M], -1 if there is none).
    """
    _native.evt2_walk(raw, block, state, seen, states, times)


def evt2_decode(
    raw: np.ndarray, width: int, height: int, state: np.ndarray, seen: np.ndarray, kept: int, *columns: np.ndarray
) -> tuple[int, int]:
    """Decode a piece of the words. O(N)."""
    found: tuple[int, int] = _native.evt2_decode(raw, width, height, state, seen, kept, *columns)
    return found


def evt2_triggers(raw: np.ndarray, state: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return times in µs, channels and levels of the external triggers in a piece of the words; updates `state`."""
    return find_triggers(_native.evt2_triggers, _native.evt2_count_triggers, raw, state)


def evt2_encode(t: np.ndarray, x: np.ndarray, y: np.ndarray, p: np.ndarray, state: np.ndarray) -> np.ndarray:
    """Encode sorted events as EVT2 words, uint32. O(N).

    `state` int64 [1] is the high part of the time that was written last, or -1 at the beginning.
    """
    words = np.empty(t.size + count_shown(t, int(state[0]), 28, 6), np.uint32)
    _native.evt2_encode(t, x, y, p, state, words)
    return words


def evt21_walk(
    raw: np.ndarray, block: int, state: np.ndarray, seen: np.ndarray, states: np.ndarray, times: np.ndarray
) -> None:
    """Walk over a piece of the words, uint8 [N], as `evt2_walk` does. O(N)."""
    _native.evt21_walk(raw, block, state, seen, states, times)


def evt21_count(raw: np.ndarray) -> int:
    """Return the number of events in a piece of the words, including those before the first time. O(N)."""
    count: int = _native.evt21_count(raw)
    return count


def evt21_decode(
    raw: np.ndarray, width: int, height: int, state: np.ndarray, seen: np.ndarray, kept: int, *columns: np.ndarray
) -> tuple[int, int]:
    """Decode a piece of the words. O(N + events). ValueError if the columns are too short."""
    found: tuple[int, int] = _native.evt21_decode(raw, width, height, state, seen, kept, *columns)
    return found


def evt21_triggers(raw: np.ndarray, state: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return times in µs, channels and levels of the external triggers in a piece of the words; updates `state`."""
    return find_triggers(_native.evt21_triggers, _native.evt21_count_triggers, raw, state)


def evt21_encode(t: np.ndarray, x: np.ndarray, y: np.ndarray, p: np.ndarray, state: np.ndarray) -> np.ndarray:
    """Encode sorted events as EVT 2.1 words, uint32 [M, 2]. O(N). `state` is that of `evt2_encode`."""
    words = np.empty((t.size + count_shown(t, int(state[0]), 28, 6), 2), np.uint32)
    halves = _native.evt21_encode(t, x, y, p, state, words.reshape(-1))
    return words[: halves // 2]
