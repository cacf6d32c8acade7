"""Prophesee RAW, EVT3: words of 16 bits, each for a row, a time, an event or a vector of pixels."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from nvsdata.formats.evt.raw import EvtRecording, extrapolated, names_encoding, write_words
from nvsdata.formats.registry import Format
from nvsdata.formats.writing import Pieces
from nvsdata.kernels.decode.evt3 import evt3_count, evt3_decode, evt3_encode, evt3_triggers, evt3_walk


class Evt3Recording(EvtRecording):
    """An EVT3 file."""

    format = "evt3"
    record_size = 2
    low_bits, high_bits = 12, 12
    state_size = 5
    walk, decode_words = evt3_walk, evt3_decode
    find_triggers = evt3_triggers

    def _most(self, raw: np.ndarray) -> int:
        # one more, because the kernel writes a row for each word, and overwrites those of words that aren't events
        return int(evt3_count(raw)) + 1

    def _capacity(self, most: int, done: int, total: int) -> int:
        return extrapolated(most, done, total)


def write(pieces: Pieces, path: Path) -> None:
    """Write EVT3. ValueError for coordinates above 2047, and for times outside [0, 2^40) µs.

    The format doesn't limit the time. nvsdata does, because a file contains every wrap of the time since 0, which takes
    0.5 MB for 2^40 µs.
    """
    write_words(pieces, path, "3.0", evt3_encode, state=3, bits=40)


FORMAT = Format("evt3", (".raw",), Evt3Recording, begins=names_encoding("3"), write=write)
