"""Prophesee RAW, EVT2: words of 32 bits, one per event."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from nvsdata.data.events import Columns
from nvsdata.formats.evt import EvtRecording, names_encoding, write_words
from nvsdata.formats.registry import Format
from nvsdata.formats.writing import Pieces
from nvsdata.kernels.evt2 import evt2_decode, evt2_encode, evt2_highs, evt2_triggers, evt2_walk


class Evt2Recording(EvtRecording):
    """An EVT2 file."""

    format = "evt2"
    record_size = 4
    low_bits, high_bits = 6, 28

    def _pass(
        self, raw: np.ndarray, state: np.ndarray, seen: np.ndarray, states: np.ndarray, times: np.ndarray
    ) -> None:
        evt2_walk(raw, self.block, state, seen, states, times)

    def _piece(self, raw: np.ndarray, state: np.ndarray, kept: int, columns: Columns) -> tuple[int, int]:
        count, bad = evt2_decode(raw, *(self._size or (0, 0)), state, self._seen, kept, *columns)
        return count, bad

    def _highs(self, raw: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        where, high = evt2_highs(raw.view(np.uint32))
        return where, high

    def _triggers(self, raw: np.ndarray, state: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        t, channel, level = evt2_triggers(raw.view(np.uint32), state)
        return t, channel, level

    def _room(self, lo: int, hi: int) -> int:
        return hi - lo


def write(pieces: Pieces, path: Path) -> None:
    """Write EVT2. ValueError for a pixel beyond 2047, and times before 0 or at or beyond 2^40 µs."""
    write_words(pieces, path, "2.0", evt2_encode, 1)


FORMAT = Format("evt2", (".raw",), Evt2Recording, begins=names_encoding("2"), write=write)
