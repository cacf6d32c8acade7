"""Prophesee RAW (`.raw`), base of EVT2, EVT 2.1 and EVT3: lines that begin with `% `, then little-endian words.

The header names the encoding (`% evt 3.0`, or `% format EVT3;height=720;width=1280`), and may state the sensor
(`% geometry 1280x720`, `% Width`, `% Height`).
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from nvsdata.common.errors import FormatError
from nvsdata.data.events import Columns, check_window
from nvsdata.data.samples import Triggers
from nvsdata.formats.contents import Contents
from nvsdata.formats.indexed import Entry, IndexedFile
from nvsdata.formats.records import Blocks, stated_size
from nvsdata.formats.writing import Pieces, file_with_header, stated_time, time_comment
from nvsdata.kernels.decode.clock import BACK_US, SILENT_US, kept_words
from nvsdata.kernels.decode.evt import FALLS, FIRST, IGNORED, JUMP, LAST, NO_TIME, TIME, UNSEEN
from nvsdata.kernels.decode.order import is_sorted

MAX_ADDRESS = 0x7FF


class EvtRecording(IndexedFile):
    """A file of words of one size. Events before the first time word are left out, because their time is unknown.

    A subclass must define `record_size` and the following.

    Attributes:
        low_bits: Number of bits of the time in event words.
        high_bits: Number of bits of the time in time words.
        state_size: Number of integers in the kernels' state.
        walk: Kernel that computes the index, as in `kernels.decode.evt2`.
        decode_words: Kernel that decodes events.
        find_triggers: Kernel that decodes triggers.
    """

    block = 4096
    holds_triggers = True
    low_bits: ClassVar[int]
    high_bits: ClassVar[int]
    state_size: ClassVar[int] = 1
    walk: ClassVar[Callable[..., Any]]
    decode_words: ClassVar[Callable[..., Any]]
    find_triggers: ClassVar[Callable[..., Any]]
    _dropped: np.ndarray | None = None  # words of a damaged file that are skipped

    def _heads(self, raw: np.ndarray) -> np.ndarray:
        """Return the words, or the lower halves of 64-bit words; their bits from `high_bits` on are the word's type."""
        size = min(self.record_size, 4)
        return raw.view(f"<u{size}")[:: self.record_size // size]

    def _ordered(self, raw: np.ndarray) -> np.ndarray:
        """Return the bytes of a piece in the order that kernels expect."""
        return raw

    def __init__(self, path: str, sensor_size: tuple[int, int] | None, head: bytes, strict: bool) -> None:
        contents = Contents(path, head)
        lines, end = contents.header(b"%")
        self.header = "\n".join(lines)
        super().__init__(contents, sensor_size, strict, header_size=end)
        stated = _stated_size(self.header)
        if self._size is None and stated:
            self._size = stated_size(path, *stated)
        self._state_times(stated_time(lines))

    def _index(self) -> Blocks:
        """Compute the index. A block's time is that of the last event before it: its first word may not be an event."""
        walk = self._walk()
        if walk[0][JUMP] >= 0:
            strays = self._strays()
            if not strays.size:
                raise FormatError(self.path, "was changed while it was read: open it again")
            if self.strict:
                reason = "a time that no camera writes: the word is damaged, or the clock was set back"
                raise FormatError(self.path, reason, offset=self._byte(int(strays[0])))
            self._dropped = strays
            self._repair("words of times that no camera writes, dropped", self._dropped.size)
            walk = self._walk()
        seen, states, times = walk
        return Blocks(times, states, not seen[FALLS], (max(int(seen[FIRST]), 0), max(int(seen[LAST]), 0)))

    def _walk(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Pass over all words; return the statistics of `kernels.decode.evt`, and the states and times of blocks."""
        count, (state, seen) = -(-self.records // self.block), self._parts(self._begun())
        states, times = np.empty((count, state.size), np.int64), np.empty(count, np.int64)
        for raw in self._pieces(0, self.records):
            type(self).walk(raw, self.block, state, seen, states, times)
        return seen, states, times

    def _entry(self, blocks: Blocks, block: int) -> Entry:
        before = max(block - 1, 0)
        state, seen = self._parts(self._begun())
        if before:
            state[:], seen[LAST] = blocks.states[before], blocks.times[before]
        states, times = np.empty((2, state.size), np.int64), np.empty(2, np.int64)
        for raw in self._pieces(before * self.block, min((block + 1) * self.block, self.records)):
            type(self).walk(raw, self.block, state, seen, states, times)
        first, last = (int(seen[which]) if seen[which] >= 0 else None for which in (FIRST, LAST))
        return Entry(int(times[block - before]), states[block - before].tolist(), first, last)

    def _strays(self) -> np.ndarray:
        """Return the indices of the time words with impossible times (see `is_jump`)."""
        begin, places, highs = 0, [], []
        for raw in self._pieces(0, self.records):
            words = self._heads(raw)
            where = np.flatnonzero(words >> self.high_bits == TIME)
            places.append(begin + where)
            highs.append(words[where].astype(np.int64) & ((1 << self.high_bits) - 1))
            begin += raw.size // self.record_size
        shift = self.low_bits
        kept = kept_words(np.concatenate(highs), self.high_bits, BACK_US >> shift, SILENT_US >> shift)
        strays: np.ndarray = np.concatenate(places)[~kept]
        return strays

    def _pieces(self, lo: int, hi: int) -> Iterator[np.ndarray]:
        for raw in super()._pieces(lo, hi):
            raw = self._ordered(raw)
            if self._dropped is not None:
                raw = raw.copy()
                first, lo = lo, lo + raw.size // self.record_size
                inside = self._dropped[(self._dropped >= first) & (self._dropped < lo)] - first
                # the byte of the word's type
                raw.reshape(-1, self.record_size)[inside, min(self.record_size, 4) - 1] = IGNORED << 4
            yield raw

    def _state(self, record: int) -> np.ndarray:
        state = self._begun()
        if record:
            state[: self.state_size] = self.blocks.states[record // self.block]
        return state

    def _begun(self) -> np.ndarray:
        """Return the state and the statistics before the first word."""
        return np.array([NO_TIME, *[0] * (self.state_size - 1), *UNSEEN])

    def _parts(self, state: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Split `state` into views of the kernels' state and of their statistics."""
        return state[: self.state_size], state[self.state_size :]

    def _piece(self, raw: np.ndarray, state: np.ndarray, kept: int, columns: Columns) -> tuple[int, int]:
        count, bad = type(self).decode_words(raw, *self._limits, *self._parts(state), kept, *columns)
        return count, bad

    def decode(self) -> Columns:
        """Decode all events. If the clock is damaged, compute the index: it raises an error or finds words to drop."""
        columns, state = self._run(0, self.records)
        if self._parts(state)[1][JUMP] >= 0 and self._blocks is None:
            # computing the index raises an error, or finds the words to drop
            self._blocks = self._index()
            columns, _ = self._run(0, self.records)
        self._rises = is_sorted(columns.t)
        return columns

    def triggers(self, start: int | None = None, stop: int | None = None) -> Triggers:
        """Return the external triggers with start <= t < stop (µs, in the file's clock) by a pass over all words."""
        check_window(start, stop)
        # computing the index finds damage
        self._blocks = self.blocks
        state = self._begun()
        find = type(self).find_triggers
        parts = [Triggers(*find(raw, self._parts(state)[0])) for raw in self._pieces(0, self.records)]
        return Triggers.joined(parts).window(start, stop)


def extrapolated(most: int, done: int, total: int) -> int:
    """Return the number of events to allocate for `total` words if the first `done` words have at most `most`."""
    # an eighth more, because growing later costs a copy; limited, because the rest may have fewer events per word
    return min(most * total // done * 9 // 8, 2 * most + 4 * (total - done)) if done < total else most


def _stated_size(text: str) -> tuple[str, str] | None:
    both = re.search(r"geometry (\d+)x(\d+)", text)
    if both:
        return both[1], both[2]
    width, height = (re.search(rf"\b{side}[ =](\d+)", text, re.IGNORECASE) for side in ("width", "height"))
    return (width[1], height[1]) if width and height else None


def names_encoding(pattern: str) -> Callable[[bytes], Any]:
    """Return a function `begins` for files whose header names an encoding such as "3"."""
    return re.compile(rb"(?:%%[^\n]*\n)*?%% (?i:evt |format EVT)%b(?!\.?[1-9])" % pattern.encode()).match


def write_words(
    pieces: Pieces,
    path: Path,
    version: str,
    encode: Callable[..., np.ndarray],
    *,
    state: int = 1,
    bits: int = 51,
    option: str = "",
) -> None:
    """Write an EVT file of `version`.

    `encode(t, x, y, p, state)` returns the words of a piece, and updates its state of `state` integers, initially -1.

    ValueError for coordinates above 2047, and for times before 0 or at or beyond 2^bits µs, because the file contains
    every wrap of the time since 0.
    """
    name = f"EVT {version}"
    if max(pieces.sensor_size) > MAX_ADDRESS + 1:
        raise ValueError(f"{name} supports coordinates up to {MAX_ADDRESS} only")
    written = np.full(state, -1, np.int64)

    def header(pieces: Pieces) -> bytes:
        width, height = pieces.sensor_size
        encoding = f"EVT{version.removesuffix('.0').replace('.', '')};height={height};width={width}{option}"
        lines = f"evt {version}", f"format {encoding}", f"geometry {width}x{height}"
        return "".join(
            f"{line}\n" for line in (*(f"% {line}" for line in lines), time_comment(pieces, "%"), "% end")
        ).encode()

    with file_with_header(path, pieces, header) as file:
        for events in pieces:
            if events.t[0] < 0 or events.t[-1] >= 1 << bits:
                first, last = events.t[0], events.t[-1]
                hint = "T.RelativeTime() counts them from the recording's beginning"
                raise ValueError(
                    f"times from {first} to {last} µs: {name} supports those from 0 to 2^{bits} only; {hint}"
                )
            file.write(encode(*events.columns, written).data)
