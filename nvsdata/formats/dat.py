"""Prophesee `.dat` (N-CARS): lines that begin with `% `, two bytes, then eight bytes per event.

The header may state Version, Width and Height. A record is a little-endian uint32 time in µs, which wraps at 2^32, and
a uint32 address. In version 2, x is in bits 0-13, y in 14-27, polarity (0 or 1) in 28-31. In version 1, x is in bits
0-8, y in 9-16, polarity in 17.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from nvsdata.common.errors import FormatError
from nvsdata.data.events import Columns
from nvsdata.formats.clocked import ClockedFile, with_times_of_32_bits
from nvsdata.formats.contents import Contents
from nvsdata.formats.records import stated_size
from nvsdata.formats.registry import Format, starts_with
from nvsdata.formats.writing import Pieces, file_with_header, stated_time, time_comment
from nvsdata.kernels.decode.clock import WRAP_US
from nvsdata.kernels.decode.dat import dat_decode

MAX_ADDRESS = 0x3FFF


class DatRecording(ClockedFile):
    """A Prophesee `.dat` file."""

    format = "prophesee-dat"
    record_size = 8

    def __init__(self, path: str, sensor_size: tuple[int, int] | None, head: bytes, strict: bool) -> None:
        contents = Contents(path, head)
        lines, end = contents.header(b"%")
        if contents.size < end + 2:
            raise FormatError(path, "truncated: no event type and size follow the header", offset=contents.size)
        kind, size = contents.read(end, end + 2).tolist()
        if kind not in (0x00, 0x0C) or size != 8:
            raise FormatError(
                path, f"event type {kind:#04x} of {size} bytes is not a change-detection event", offset=end
            )
        super().__init__(contents, sensor_size, strict, header_size=end + 2)
        numbers = {m[1].lower(): m[2] for line in lines if (m := re.match(r"%\s*(\w+)\s+(\d+)\s*$", line))}
        self.version = 1 if numbers.get("version", "1") in ("0", "1") else 2
        if self._size is None and "width" in numbers and "height" in numbers:
            self._size = stated_size(path, numbers["width"], numbers["height"])
        self._state_times(stated_time(lines))

    def _times(self, raw: np.ndarray) -> np.ndarray:
        return raw.view("<u4")[::2]

    def _piece(self, raw: np.ndarray, state: np.ndarray, kept: int, columns: Columns) -> tuple[int, int]:
        count, bad = dat_decode(raw, self.block, self.version, *self._limits, state, kept, *columns)
        return count, bad


def write(pieces: Pieces, path: Path) -> None:
    """Write version 2 records, type 0x0C.

    ValueError for coordinates above 16383, and for times that a reader couldn't unwrap: the first time must be in
    [0, 2^32 - 1) µs, and gaps must be shorter than 2^31 µs, and at most five minutes where the 32 bits wrap.
    """
    width, height = pieces.sensor_size
    if max(width, height) > MAX_ADDRESS + 1:
        raise ValueError("Prophesee .dat supports coordinates up to 16383 only")
    with file_with_header(path, pieces, _header) as file:
        for events in with_times_of_32_bits(pieces, "Prophesee .dat"):
            words = np.empty((len(events), 2), "<u4")
            words[:, 0] = (events.t % WRAP_US).astype(np.uint32)
            words[:, 1] = events.x.astype(np.uint32) | events.y.astype(np.uint32) << 14
            words[:, 1] |= events.p.astype(np.uint32) << 28
            file.write(words.data)


def _header(pieces: Pieces) -> bytes:
    width, height = pieces.sensor_size
    lines = ("% Data file containing CD events.", time_comment(pieces, "%"), "% Version 2")
    return "".join(f"{line}\n" for line in (*lines, f"% Width {width}", f"% Height {height}")).encode() + b"\x0c\x08"


FORMAT = Format("prophesee-dat", (".dat",), DatRecording, begins=starts_with(b"% "), write=write)
