"""ATIS, `.bin` (N-MNIST, N-Caltech101): records of 40 bits, without a header.

Byte 0 is x, byte 1 is y, bit 7 of byte 2 is the polarity. The other 23 bits are the time in µs, most significant
first. A record with y = 240 is not an event: it adds 2^13 µs to all later times. A larger y is damage.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from nvsdata.common.errors import FormatError
from nvsdata.data.events import Columns, check_sensor_size
from nvsdata.formats.contents import Contents
from nvsdata.formats.indexed import Entry, IndexedFile
from nvsdata.formats.records import Blocks
from nvsdata.formats.registry import Format
from nvsdata.formats.writing import Pieces
from nvsdata.kernels.decode.atis import (
    ATIS_BEGUN,
    ATIS_FIRST,
    ATIS_LAST,
    ATIS_OVERFLOW_Y,
    BOTTOM,
    DAMAGE,
    DAMAGED,
    FALLS,
    MARKERS,
    OVERFLOW,
    RECORDS,
    RIGHT,
    atis_decode,
    atis_encode,
    atis_walk,
)

SHORT = 32  # blocks; a file up to this size is decoded entirely
MAX_WRITTEN_US = 1 << 33  # which takes a million overflow records; longer recordings need another format


class AtisRecording(IndexedFile):
    """An ATIS `.bin` file. It doesn't state a sensor size: the default is the smallest that contains its events."""

    format = "atis"
    record_size = 5
    block = 256
    _extent = (1, 1)  # width and height that contain the events, found by a pass over all records

    def __init__(self, path: str, sensor_size: tuple[int, int] | None, head: bytes, strict: bool) -> None:
        super().__init__(Contents(path, head), sensor_size, strict)
        self._given = self._size

    def decode_size(self) -> tuple[int, int]:
        if self.strict and not self._short:
            # computing the index finds the size
            self._blocks = self.blocks
            return self._size or self._extent
        walk = self._walk()[0]
        return int(walk[RIGHT]), int(walk[BOTTOM])

    @property
    def size_is_guessed(self) -> bool:
        return self._given is None

    @property
    def _short(self) -> bool:
        """True if any window decodes the entire file, because an index, which needs every record, takes as long."""
        return self.records <= SHORT * self.block

    def decode_window(self, start: int, stop: int) -> Columns | None:
        return None if self._short else super().decode_window(start, stop)

    def decode_span(self) -> tuple[int, int] | None:
        return None if self._short else super().decode_span()

    def _walk(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the state of `atis_walk` after all records, and the time and overflow of each block.

        If `strict`, FormatError for a damaged record.
        """
        count = -(-self.records // self.block)
        walk, times, offsets = np.array(ATIS_BEGUN), np.empty(count, np.int64), np.empty((count, 1), np.int64)
        for raw in self._pieces(0, self.records):
            atis_walk(raw, self.block, walk, times, offsets)
            self._check_rows(int(walk[DAMAGE]))
        return walk, times, offsets

    def _index(self) -> Blocks:
        walk, times, offsets = self._walk()
        self._extent = int(walk[RIGHT]), int(walk[BOTTOM])
        # replaces the extent of a cached index that proved wrong
        self._size = self._given or self._extent
        return Blocks(times, offsets, not walk[FALLS], (int(walk[ATIS_FIRST]), int(walk[ATIS_LAST])))

    def _entry(self, blocks: Blocks, block: int) -> Entry:
        before = max(block - 1, 0)
        walk, times, offsets = np.array(ATIS_BEGUN), np.empty(2, np.int64), np.empty((2, 1), np.int64)
        walk[OVERFLOW], walk[ATIS_LAST] = blocks.states[before, 0], blocks.times[before]
        for raw in self._pieces(before * self.block, min((block + 1) * self.block, self.records)):
            atis_walk(raw, self.block, walk, times, offsets)
        if walk[RIGHT] > self._extent[0] or walk[BOTTOM] > self._extent[1]:
            raise ValueError("events outside the extent of an index")
        some = walk[RECORDS] > walk[MARKERS] + walk[DAMAGED]
        first, last = (int(walk[which]) if some else None for which in (ATIS_FIRST, ATIS_LAST))
        return Entry(int(times[block - before]), offsets[block - before].tolist(), first, last)

    def _to_cache(self, blocks: Blocks) -> dict[str, np.ndarray]:
        return {**super()._to_cache(blocks), "extent": np.array(self._extent)}

    def _restored(self, kept: dict[str, np.ndarray]) -> Blocks:
        self._extent = check_sensor_size(kept["extent"].tolist())
        blocks = super()._restored(kept)
        self._size = self._given or self._extent
        return blocks

    def _state(self, record: int) -> np.ndarray:
        overflow = int(self.blocks.states[record // self.block, 0]) if record else 0
        return np.array([overflow, record, 0, -1])

    def _check(self, state: np.ndarray) -> None:
        self._check_rows(int(state[3]))

    def _check_rows(self, damaged: int) -> None:
        """If `strict`, raise FormatError for the damaged record with the number `damaged`, unless that is -1."""
        if self.strict and damaged >= 0:
            y = int(self.contents.read(self._byte(damaged), self._byte(damaged + 1))[1])
            reason = f"y = {y} is damage, because events have y below {ATIS_OVERFLOW_Y}; strict=False drops the record"
            raise FormatError(self.path, reason, offset=self._byte(damaged))

    def decode(self) -> Columns:
        columns, state = self._run(0, self.records)
        self._repair(f"records of y above {ATIS_OVERFLOW_Y}, dropped", int(state[2]))
        return columns

    def _piece(self, raw: np.ndarray, state: np.ndarray, kept: int, columns: Columns) -> tuple[int, int]:
        count, bad = atis_decode(raw, *self._limits, state, kept, *columns)
        return count, bad

    def anomalies(self) -> dict[str, int]:
        return {**super().anomalies(), "time overflow records": int(self._walk()[0][MARKERS])}


def looks_like(head: bytes, size: int) -> bool:
    """Return whether a file of `size` bytes that begins with `head` could be ATIS.

    Its size must be a multiple of a record, and the times at its beginning must rise.
    """
    raw = np.frombuffer(head[: 5 * 256], np.uint8)
    if size % 5 or raw.size < 5 * 16:
        return False
    raw = raw.reshape(-1, 5).astype(np.int64)
    t = (raw[:, 2] & 0x7F) << 16 | raw[:, 3] << 8 | raw[:, 4]
    return bool((np.diff(t) >= 0).all() and t[-1] > t[0] and (raw[:, 1] <= ATIS_OVERFLOW_Y).all())


def write(pieces: Pieces, path: Path) -> None:
    """Write ATIS records. ValueError for x > 255, y > 239, t < 0 or t >= 2^33 µs."""
    offset = 0
    with path.open("wb") as file:
        for events in pieces:
            if events.x.max() > 255 or events.y.max() >= ATIS_OVERFLOW_Y:
                raise ValueError("ATIS .bin supports x up to 255 and y up to 239 only")
            if events.t[0] < 0 or events.t[-1] >= MAX_WRITTEN_US:
                raise ValueError(f"ATIS .bin supports times from 0 to {MAX_WRITTEN_US - 1} µs only")
            raw, offset = atis_encode(*events.columns, offset)
            file.write(raw.data)


FORMAT = Format("atis", (".bin", ".bs2"), AtisRecording, looks_like=looks_like, write=write)
