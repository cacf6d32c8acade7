"""ATIS 40-bit records, `.bin` (N-MNIST, N-Caltech101): no header, five bytes an event.

Byte 0 is x, byte 1 y, bit 7 of byte 2 the polarity, the other 23 bits the time in µs, most
significant first. A record with y = 240 is no event: it adds 2^13 µs to every later time.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np

from nvsdata.events import Columns, Events
from nvsdata.formats.records import Blocks, RecordFile
from nvsdata.kernels.decode import ATIS_OVERFLOW_Y, atis_blocks, atis_decode, atis_encode

SHORT = 32  # blocks of a file that is decoded as a whole
MAX_WRITTEN_US = 1 << 33  # a million overflow records; beyond that the format is the wrong one


class Recording(RecordFile):
    """An ATIS `.bin` file; it holds no sensor size: by default the one that its events need."""

    format = "atis"
    record_size = 5
    block = 256

    def _needed_size(self) -> tuple[int, int]:
        width, height = atis_blocks(self._raw, self.block)[4]
        return width, height

    @property
    def _short(self) -> bool:
        """Whether windows are cut from the whole: the index takes as long, for it has to look at every record."""
        return self.records <= SHORT * self.block

    def _window(self, start: int, stop: int) -> Columns | None:
        return None if self._short else super()._window(start, stop)

    def _bounds(self) -> tuple[int, int] | None:
        return None if self._short else super()._bounds()

    def _index(self) -> Blocks:
        times, offsets, ordered, span, size, _ = atis_blocks(self._raw, self.block)
        if self._size is None:
            self._size = size
        return Blocks(times, offsets, ordered, span)

    def _records(self, lo: int, hi: int, offset: int) -> tuple[Columns, int]:
        width, height = self._size or (0, 0)
        columns = Columns.room(hi - lo)
        count, bad = atis_decode(self._raw, lo, hi, offset, width, height, *columns)
        return columns.first(count), bad

    def anomalies(self) -> dict[str, int]:
        return {**super().anomalies(), "time overflow records": int(atis_blocks(self._raw, self.block)[5])}


def looks_like(head: bytes, size: int) -> bool:
    """Whether a file of `size` bytes that begins so could be one: whole records, times that never fall."""
    raw = np.frombuffer(head[: 5 * 256], np.uint8)
    if size % 5 or raw.size < 5 * 16:
        return False
    raw = raw[: raw.size - raw.size % 5].reshape(-1, 5).astype(np.int64)
    t = (raw[:, 2] & 0x7F) << 16 | raw[:, 3] << 8 | raw[:, 4]
    return bool((np.diff(t) >= 0).all() and t[-1] > t[0] and (raw[:, 1] <= ATIS_OVERFLOW_Y).all())


def write(pieces: Iterable[Events], sensor_size: tuple[int, int], path: Path) -> None:
    """Write ATIS records. ValueError for x > 255, y > 239, t < 0 or t >= 2^33 µs."""
    offset = 0
    with path.open("wb") as file:
        for events in pieces:
            if events.x.max() > 255 or events.y.max() >= ATIS_OVERFLOW_Y:
                raise ValueError("ATIS .bin holds x up to 255 and y up to 239 only")
            if events.t[0] < 0 or events.t[-1] >= MAX_WRITTEN_US:
                raise ValueError(f"ATIS .bin holds times from 0 to {MAX_WRITTEN_US - 1} µs only")
            raw, offset = atis_encode(*events.columns, offset)
            file.write(raw)
