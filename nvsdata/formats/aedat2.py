"""AEDAT 1.0 and 2.0 (jAER): MNIST-DVS, CIFAR10-DVS, UCF50-DVS, HMDB51-DVS.

Header lines begin with `#` and end CR LF. Records are big-endian: a 32-bit address (1.0: 16 bits)
and a 32-bit time in µs that wraps. What the address bits mean depends on the camera, which the
line `# AEChip:` names; without it, `sensor_size` or the addresses themselves tell.

- DVS128: bit 0 polarity (0 is ON), bits 1-7 x, bits 8-14 y, bit 15 external event
- DAVIS: bit 11 polarity (1 is ON), bits 12-21 x, bits 22-30 y, bit 31 frame or inertial sample,
  bit 10 external event

x is mirrored and y counts from the bottom; both are turned, so that the origin is top left.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from nvsdata.errors import FormatError
from nvsdata.events import Columns, Events
from nvsdata.formats.records import Blocks, RecordFile, bytes_of, header_lines, unwrapped_index, with_times_of_32_bits
from nvsdata.kernels.aedat import DAVIS, DVS128, aedat2_decode, aedat2_encode

# camera, as the class name in `# AEChip:` ends: size, layout, the class name that is written
CHIPS = {
    "DVS128": ((128, 128), DVS128, "ch.unizh.ini.jaer.chip.retina.DVS128"),
    "DAVIS240": ((240, 180), DAVIS, "eu.seebetter.ini.chips.davis.DAVIS240C"),
    "DAVIS346": ((346, 260), DAVIS, "eu.seebetter.ini.chips.davis.Davis346red"),
}


class Recording(RecordFile):
    """An AEDAT 2.0 file; that of 1.0 differs in its records' size."""

    format = "aedat2"
    record_size = 8
    block = 4096

    def __init__(self, path: str, sensor_size: tuple[int, int] | None, head: bytes, strict: bool) -> None:
        # jAER puts its preferences into the header, which then is longer than any head
        lines, end = header_lines(bytes_of(path, head), b"#")
        super().__init__(path, sensor_size, head, strict, header_size=end)
        self._words = self._as_words()
        chip = next((m[1].upper() for line in lines if (m := re.match(r"#\s*AEChip:.*?(\w+)\s*$", line))), None)
        self.chip_size, self.layout = self._camera(chip)
        self._size = self._size or self.chip_size

    def _camera(self, chip: str | None) -> tuple[tuple[int, int], int]:
        """Size and address layout: as the header says, else as the sensor's size or the addresses tell."""
        for name, (size, layout, _) in CHIPS.items():
            if chip is not None and chip.startswith(name):
                return size, layout
        if chip is not None:
            raise FormatError(self.path, 0, f"recorded by a {chip}; known are {', '.join(CHIPS)}")
        for size, layout, _ in CHIPS.values():
            if self._size == size:
                return size, layout
        # a DVS128's addresses have 16 bits
        name = "DVS128" if not (self._words[: self.block, 0] & 0xFFFF).any() else "DAVIS240"
        return CHIPS[name][:2]

    def _as_words(self) -> np.ndarray:
        """Address and time of the records, [N, 2], as if they were little-endian."""
        if self.record_size == 8:
            return self._raw.view("<u4").reshape(-1, 2)
        wide = np.zeros((self.records, 8), np.uint8)
        wide[:, 2:] = self._raw.reshape(-1, 6)
        return wide.view("<u4")

    def _index(self) -> Blocks:
        return unwrapped_index(np.ascontiguousarray(self._words[:: self.block, 1]).view(">u4"))

    def _records(self, lo: int, hi: int, offset: int) -> tuple[Columns, int]:
        words, sizes = self._words.reshape(-1), (*self.chip_size, *self.sensor_size)
        columns = Columns.room(hi - lo)
        count, bad = aedat2_decode(words, lo, hi, offset, self.layout, *sizes, *columns)
        return columns.first(count), bad


def write(pieces: Iterable[Events], sensor_size: tuple[int, int], path: Path) -> None:
    """Write AEDAT 2.0 records of the smallest of DVS128, DAVIS240C and DAVIS346 that holds the sensor.

    ValueError for a larger sensor, a first time outside [0, 2^32) µs or a gap of 2^31 µs or more:
    a reader could not unwrap the 32-bit times.
    """
    width, height = sensor_size
    chips = [chip for chip in CHIPS.values() if width <= chip[0][0] and height <= chip[0][1]]
    if not chips:
        raise ValueError(f"AEDAT 2.0 is written for sensors up to 346x260, not {width}x{height}")
    size, layout, name = chips[0]
    with path.open("wb") as file:
        file.write(header("2.0", name))
        for events in with_times_of_32_bits(pieces, "AEDAT 2.0"):
            file.write(aedat2_encode(*events.columns, layout, *size))


def header(version: str, chip: str) -> bytes:
    """What a file begins with."""
    lines = (f"#!AER-DAT{version}", "# Written by nvsdata", "# Timestamps tick is 1 us", f"# AEChip: {chip}")
    return "".join(f"{line}\r\n" for line in (*lines, "#End Of ASCII Header")).encode()
