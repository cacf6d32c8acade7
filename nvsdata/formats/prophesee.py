"""Prophesee `.dat` (N-CARS): lines beginning with `% `, two bytes, then eight bytes an event.

The header may state Version, Width and Height. A record is a little-endian uint32 time in µs
(it wraps at 2^32) and a uint32 address: version 2 has x in bits 0-13, y in 14-27, polarity in 28;
version 1 has x in bits 0-8, y in 9-16, polarity in 17.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from nvsdata.errors import FormatError
from nvsdata.events import Columns, Events
from nvsdata.formats.records import Blocks, RecordFile, header_lines, unwrapped_index, with_times_of_32_bits
from nvsdata.kernels.decode import WRAP_US, dat_decode

MAX_ADDRESS = 0x3FFF


class Recording(RecordFile):
    """A Prophesee `.dat` file."""

    format = "prophesee-dat"
    record_size = 8
    block = 4096

    def __init__(self, path: str, sensor_size: tuple[int, int] | None, head: bytes, strict: bool) -> None:
        lines, end = header_lines(head, b"%")
        if len(head) < end + 2:
            raise FormatError(path, len(head), "truncated: the header has no event type and size after it")
        kind, size = head[end], head[end + 1]
        if kind not in (0x00, 0x0C) or size != 8:
            raise FormatError(path, end, f"event type {kind:#04x} of {size} bytes is no change-detection event")
        super().__init__(path, sensor_size, head, strict, header_size=end + 2)
        numbers = {m[1].lower(): int(m[2]) for line in lines if (m := re.match(r"%\s*(\w+)\s+(\d+)\s*$", line))}
        self.version = numbers.get("version", 1)
        stated = (numbers.get("width", 0), numbers.get("height", 0))
        self._size = self._size or (stated if all(stated) else None)
        self._words = self._raw.view("<u4").reshape(-1, 2)

    def _index(self) -> Blocks:
        return unwrapped_index(self._words[:: self.block, 0])

    def _records(self, lo: int, hi: int, offset: int) -> tuple[Columns, int]:
        width, height = self._size or (0, 0)
        columns = Columns.room(hi - lo)
        count, bad = dat_decode(self._words.reshape(-1), lo, hi, offset, self.version, width, height, *columns)
        return columns.first(count), bad


def write(pieces: Iterable[Events], sensor_size: tuple[int, int], path: Path) -> None:
    """Write version 2 records, type 0x0C. ValueError for a pixel beyond 16383 or a time that wraps out of reach.

    The first time must lie in [0, 2^32) µs, and no gap may reach 2^31 µs: only so can a reader
    unwrap the 32-bit times.
    """
    width, height = sensor_size
    if max(width, height) > MAX_ADDRESS + 1:
        raise ValueError("Prophesee .dat holds coordinates up to 16383 only")
    header = f"% Data file containing CD events.\n% Version 2\n% Width {width}\n% Height {height}\n"
    with path.open("wb") as file:
        file.write(header.encode() + b"\x0c\x08")
        for events in with_times_of_32_bits(pieces, "Prophesee .dat"):
            words = np.empty((len(events), 2), "<u4")
            words[:, 0] = (events.t % WRAP_US).astype(np.uint32)
            words[:, 1] = events.x.astype(np.uint32) | events.y.astype(np.uint32) << 14
            words[:, 1] |= events.p.astype(np.uint32) << 28
            file.write(words.data)
