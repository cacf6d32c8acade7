"""Prophesee RAW, EVT2 and EVT3 (`.raw`): header lines that begin with `% `, then little-endian words.

The header names the encoding (`% evt 3.0`, or `% format EVT3;height=720;width=1280`) and may state
the sensor (`% geometry 1280x720`, `% Width`, `% Height`).
"""

from __future__ import annotations

import re
from collections.abc import Iterator

import numpy as np

from nvsdata.common.errors import FormatError
from nvsdata.data.events import Columns
from nvsdata.formats.contents import Contents
from nvsdata.formats.records import Blocks, PiecedFile, stated_size
from nvsdata.formats.registry import Format
from nvsdata.kernels.clock import BACK_US, SILENT_US, kept_words
from nvsdata.kernels.evt import (
    FALLS,
    FIRST,
    IGNORED,
    JUMP,
    LAST,
    UNDATED,
    UNSEEN,
    evt2_decode,
    evt2_highs,
    evt2_walk,
    evt3_count,
    evt3_decode,
    evt3_highs,
    evt3_walk,
)
from nvsdata.kernels.order import is_sorted

ENCODING = re.compile(r"^% (?:evt |format EVT)([23])", re.IGNORECASE | re.MULTILINE)


class EvtRecording(PiecedFile):
    """An EVT2 or EVT3 file. Events before the first time word are left out, because they have no time."""

    format = "evt"
    block = 4096
    _events: np.ndarray  # number of events in each block, EVT3 only
    _dropped: np.ndarray | None = None  # words of a damaged file that are skipped

    def __init__(self, path: str, sensor_size: tuple[int, int] | None, head: bytes, strict: bool) -> None:
        contents = Contents(path, head)
        lines, end = contents.header(b"%")
        text = "\n".join(lines)
        encoding = ENCODING.search(text)
        if encoding is None:
            raise FormatError(path, "the header names neither EVT2 nor EVT3", offset=0)
        self.version = int(encoding[1])
        self.record_size = 4 if self.version == 2 else 2
        self._seen = np.array(UNSEEN)
        super().__init__(contents, sensor_size, strict, header_size=end)
        stated = _stated_size(text)
        if self._size is None and stated:
            self._size = stated_size(path, *stated)

    def _index(self) -> Blocks:
        """The index, by the last event before each block, because a block's first word needn't be an event."""
        walk = self._walk()
        if walk[0][JUMP] >= 0:
            strays = self._strays()
            if self.strict:
                reason = "a time that no camera writes: the word is damaged, or the clock was set back"
                raise FormatError(self.path, reason, offset=self._byte(int(strays[0])))
            self._dropped = strays
            self._repair("words of times that no camera writes, dropped", self._dropped.size)
            walk = self._walk()
        seen, states, times = walk
        return Blocks(times, states, not seen[FALLS], (max(int(seen[FIRST]), 0), max(int(seen[LAST]), 0)))

    def _walk(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """What a walk over all words has seen (see `kernels.evt`), and the blocks' states and times."""
        count, state = -(-self.records // self.block), self._undated()
        states, times = np.empty((count, state.size), np.int64), np.empty(count, np.int64)
        seen, self._events = np.array(UNSEEN), np.zeros(count, np.int64)
        for raw in self._pieces(0, self.records):
            if self.version == 2:
                evt2_walk(raw, self.block, state, seen, states, times)
            else:
                evt3_walk(raw, self.block, state, seen, states, times, self._events)
        return seen, states, times

    def _strays(self) -> np.ndarray:
        """Indices of the time words that no camera wrote."""
        find, bits, shift = (evt2_highs, 28, 6) if self.version == 2 else (evt3_highs, 12, 12)
        begin, places, highs = 0, [], []
        for raw in self._pieces(0, self.records):
            where, high = find(raw)
            places.append(begin + where)
            highs.append(high)
            begin += raw.size // self.record_size
        kept = kept_words(np.concatenate(highs), bits, BACK_US >> shift, SILENT_US >> shift)
        strays: np.ndarray = np.concatenate(places)[~kept]
        return strays

    def _pieces(self, lo: int, hi: int) -> Iterator[np.ndarray]:
        for raw in super()._pieces(lo, hi):
            if self._dropped is not None:
                raw = raw.copy()
                first, lo = lo, lo + raw.size // self.record_size
                inside = self._dropped[(self._dropped >= first) & (self._dropped < lo)] - first
                raw.reshape(-1, self.record_size)[inside, -1] = IGNORED << 4
                raw.flags.writeable = False
            yield raw

    def _state(self, record: int) -> np.ndarray:
        return self.blocks.states[record // self.block].copy() if record else self._undated()

    def _undated(self) -> np.ndarray:
        return np.array(UNDATED[: 1 if self.version == 2 else 5])

    def _room(self, lo: int, hi: int) -> int:
        if self.version == 2:
            return hi - lo
        if self._blocks is None:
            count = sum(int(evt3_count(raw)) for raw in self._pieces(lo, hi))
        else:
            count = int(self._events[lo // self.block : -(-hi // self.block)].sum())
        # one more, because words that are no events are written, too, and then written over
        return count + 1

    def _piece(self, raw: np.ndarray, state: np.ndarray, kept: int, columns: Columns) -> tuple[int, int]:
        width, height = self._size or (0, 0)
        decode = evt2_decode if self.version == 2 else evt3_decode
        count, bad = decode(raw, width, height, state, self._seen, kept, *columns)
        return count, bad

    def decode(self) -> Columns:
        """All events, without the index unless the clock is damaged."""
        self._seen[:] = UNSEEN
        columns = super().decode()
        if self._seen[JUMP] >= 0 and self._blocks is None:
            # an error, or words that are dropped
            self._blocks = self._index()
            columns = super().decode()
        self._rises = is_sorted(columns.t)
        return columns


def _stated_size(text: str) -> tuple[str, str] | None:
    both = re.search(r"geometry (\d+)x(\d+)", text)
    if both:
        return both[1], both[2]
    width, height = (re.search(rf"\b{side}[ =](\d+)", text, re.IGNORECASE) for side in ("width", "height"))
    return (width[1], height[1]) if width and height else None


FORMAT = Format("evt", (".raw",), EvtRecording, begins=re.compile(rb"(?:%[^\n]*\n)*?% (?i:evt |format EVT)[23]").match)
