"""Prophesee RAW, EVT3: words of 16 bits, with rows, times and vectors of pixels of their own."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from nvsdata.data.events import Columns
from nvsdata.formats.evt import EvtRecording, names_encoding, write_words
from nvsdata.formats.registry import Format
from nvsdata.formats.writing import Pieces
from nvsdata.kernels.evt3 import evt3_count, evt3_decode, evt3_encode, evt3_highs, evt3_triggers, evt3_walk


class Evt3Recording(EvtRecording):
    """An EVT3 file."""

    format = "evt3"
    record_size = 2
    low_bits, high_bits = 12, 12
    state_size = 5

    def _pass(
        self, raw: np.ndarray, state: np.ndarray, seen: np.ndarray, states: np.ndarray, times: np.ndarray
    ) -> None:
        evt3_walk(raw, self.block, state, seen, states, times, self._events)

    def _piece(self, raw: np.ndarray, state: np.ndarray, kept: int, columns: Columns) -> tuple[int, int]:
        count, bad = evt3_decode(raw, *(self._size or (0, 0)), state, self._seen, kept, *columns)
        return count, bad

    def _highs(self, raw: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        where, high = evt3_highs(raw)
        return where, high

    def _triggers(self, raw: np.ndarray, state: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        t, channel, level = evt3_triggers(raw, state)
        return t, channel, level

    def _count(self, raw: np.ndarray) -> int:
        return int(evt3_count(raw))


def write(pieces: Pieces, path: Path) -> None:
    """Write EVT3. ValueError for a pixel beyond 2047, and times before 0 or at or beyond 2^40 µs."""
    write_words(pieces, path, "3.0", evt3_encode, 3)


FORMAT = Format("evt3", (".raw",), Evt3Recording, begins=names_encoding("3"), write=write)
