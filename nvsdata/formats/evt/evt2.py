"""Prophesee RAW, EVT2: words of 32 bits, one per event."""

from __future__ import annotations

from pathlib import Path

from nvsdata.formats.evt.raw import EvtRecording, names_encoding, write_words
from nvsdata.formats.registry import Format
from nvsdata.formats.writing import Pieces
from nvsdata.kernels.decode.evt2 import evt2_decode, evt2_encode, evt2_triggers, evt2_walk


class Evt2Recording(EvtRecording):
    """An EVT2 file."""

    format = "evt2"
    record_size = 4
    low_bits, high_bits = 6, 28
    walk, decode_words = evt2_walk, evt2_decode
    find_triggers = evt2_triggers


def write(pieces: Pieces, path: Path) -> None:
    """Write EVT2. ValueError for a pixel beyond 2047, and times before 0 or at or beyond 2^51 µs."""
    write_words(pieces, path, "2.0", evt2_encode)


FORMAT = Format("evt2", (".raw",), Evt2Recording, begins=names_encoding("2"), write=write)
