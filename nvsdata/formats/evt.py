"""Prophesee RAW, EVT2 and EVT3 (`.raw`): header lines beginning with `% `, then little-endian words.

The header names the encoding (`% evt 3.0`, or `% format EVT3;height=720;width=1280`) and may state
the sensor (`% geometry 1280x720`, `% Width`, `% Height`).
"""

from __future__ import annotations

import re

import numpy as np

from nvsdata.errors import FormatError
from nvsdata.events import Columns
from nvsdata.formats.records import Blocks, RecordFile, header_lines
from nvsdata.kernels.evt import evt2_decode, evt2_states, evt3_decode, evt3_states

ENCODING = re.compile(r"^% (?:evt |format EVT)([23])", re.IGNORECASE | re.MULTILINE)


class Recording(RecordFile):
    """An EVT2 or EVT3 file. Events before the first word that gives the time are left out, as nothing dates them."""

    format = "evt"
    block = 4096
    _states: np.ndarray
    _events: np.ndarray

    def __init__(self, path: str, sensor_size: tuple[int, int] | None, head: bytes, strict: bool) -> None:
        lines, end = header_lines(head, b"%")
        text = "\n".join(lines)
        encoding = ENCODING.search(text)
        if encoding is None:
            raise FormatError(path, 0, "the header names neither EVT2 nor EVT3")
        self.version = int(encoding[1])
        self.record_size = 4 if self.version == 2 else 2
        super().__init__(path, sensor_size, head, strict, header_size=end)
        self._words = self._raw.view("<u4" if self.version == 2 else "<u2")
        self._size = self._size or _stated_size(text)

    def _index(self) -> Blocks:
        """By the last event before each block, for the block's first word needn't be an event."""
        if self.version == 2:
            self._states, times, ordered, span = evt2_states(self._words, self.block)
        else:
            self._states, times, self._events, ordered, span = evt3_states(self._words, self.block)
        return Blocks(times, np.zeros_like(times), bool(ordered), span)

    def _records(self, lo: int, hi: int, offset: int) -> tuple[Columns, int]:
        first, last = lo // self.block, -(-hi // self.block)
        if not self.blocks.times.size:
            return Columns.room(0), -1
        width, height = self._size or (0, 0)
        if self.version == 2:
            decode, columns = evt2_decode, Columns.room(hi - lo)
        else:
            decode, columns = evt3_decode, Columns.room(int(self._events[first:last].sum()))
        count, bad = decode(self._words, lo, hi, self._states[first], width, height, *columns)
        return columns.first(count), bad


def _stated_size(text: str) -> tuple[int, int] | None:
    both = re.search(r"geometry (\d+)x(\d+)", text)
    if both:
        return int(both[1]), int(both[2])
    width, height = (re.search(rf"\b{side}[ =](\d+)", text, re.IGNORECASE) for side in ("width", "height"))
    return (int(width[1]), int(height[1])) if width and height else None
