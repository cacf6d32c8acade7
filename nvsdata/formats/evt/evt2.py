"""Prophesee RAW, EVT2 and EVT 2.1.

EVT2 has words of 32 bits, one per event. EVT 2.1 has words of 64 bits, each for up to 32 pixels of a row. Its header
states which half of a word comes first. With `endianness=legacy`, as from the IMX636, it is the half with the word's
type; with `endianness=little`, as from the GenX320, it is the other half. If the header doesn't state it, the order is
found from the words.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from nvsdata.formats.evt.raw import EvtRecording, extrapolated, names_encoding, write_words
from nvsdata.formats.registry import Format
from nvsdata.formats.writing import Pieces
from nvsdata.kernels.decode.evt import TIME
from nvsdata.kernels.decode.evt2 import (
    evt2_decode,
    evt2_encode,
    evt2_triggers,
    evt2_walk,
    evt21_count,
    evt21_decode,
    evt21_encode,
    evt21_triggers,
    evt21_walk,
)

LOOKED_AT = 4096  # words at the beginning of a file from which the order of the halves is found


class Evt2Recording(EvtRecording):
    """An EVT2 file."""

    format = "evt2"
    record_size = 4
    low_bits, high_bits = 6, 28
    walk, decode_words = evt2_walk, evt2_decode
    find_triggers = evt2_triggers


def write(pieces: Pieces, path: Path) -> None:
    """Write EVT2. ValueError for coordinates above 2047, and for times before 0 or at or beyond 2^51 µs."""
    write_words(pieces, path, "2.0", evt2_encode)


class Evt21Recording(EvtRecording):
    """An EVT 2.1 file."""

    format = "evt2.1"
    record_size = 8
    low_bits, high_bits = 6, 28
    walk, decode_words = evt21_walk, evt21_decode
    find_triggers = evt21_triggers
    _reversed = False  # whether the half with the type is the second one

    def __init__(self, path: str, sensor_size: tuple[int, int] | None, head: bytes, strict: bool) -> None:
        super().__init__(path, sensor_size, head, strict)
        stated = re.search(r"\bendianness[ =](little|legacy)", self.header, re.IGNORECASE)
        self._reversed = stated[1].lower() == "little" if stated else self._seems_reversed()

    def _seems_reversed(self) -> bool:
        """Return whether the two 32-bit halves of words are swapped in this file.

        A time word has its time in the first half and zeros in the second one; swapped words have the opposite.
        """
        halves = self.contents.read(self._byte(0), self._byte(min(self.records, LOOKED_AT))).view("<u4").reshape(-1, 2)
        first, second = np.count_nonzero((halves >> 28 == TIME) & (halves[:, ::-1] == 0), 0)
        return bool(second > first)

    def _ordered(self, raw: np.ndarray) -> np.ndarray:
        if not self._reversed:
            return raw
        return np.ascontiguousarray(raw.view(np.uint32).reshape(-1, 2)[:, ::-1]).reshape(-1).view(np.uint8)

    def _most(self, raw: np.ndarray) -> int:
        return int(evt21_count(raw))

    def _capacity(self, most: int, done: int, total: int) -> int:
        return extrapolated(most, done, total)


def write_evt21(pieces: Pieces, path: Path) -> None:
    """Write EVT 2.1. ValueError for coordinates above 2047, and for times before 0 or at or beyond 2^51 µs."""
    write_words(pieces, path, "2.1", evt21_encode, option=";endianness=legacy")


FORMAT = Format("evt2", (".raw",), Evt2Recording, begins=names_encoding("2"), write=write)
EVT21 = Format("evt2.1", (".raw",), Evt21Recording, begins=names_encoding(r"2\.?1"), write=write_evt21)
