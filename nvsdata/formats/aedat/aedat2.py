"""AEDAT 1.0 and 2.0 (jAER): MNIST-DVS, CIFAR10-DVS, UCF50-DVS, HMDB51-DVS.

Header lines begin with `#` and end with CR LF. Records are big-endian: an address of 32 bits (1.0: 16 bits), and a time
in µs of 32 bits, which wraps. The meaning of the address bits depends on the camera, which the line `# AEChip:` names;
without that line it follows from `sensor_size` or from the addresses. nvsdata's own files of a smaller sensor state its
size in another comment.

- DVS128: bit 0 polarity (0 is ON), bits 1-7 x, bits 8-14 y, bit 15 external event
- DAVIS: bit 11 polarity (1 is ON), bits 12-21 x, bits 22-30 y, bit 31 frame or inertial sample
  (`nvsdata.formats.aedat.aedat2_samples`), bit 10 external event

x is mirrored and y counts from the bottom; both are converted, so that the origin is top left.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from nvsdata.common.errors import FormatError
from nvsdata.data.events import Columns
from nvsdata.data.samples import Frame, Inertial, within
from nvsdata.formats.aedat.aedat2_samples import WRITTEN, Scales, davis_frames, davis_inertial, merged_records
from nvsdata.formats.clocked import ClockedFile, with_times_of_32_bits
from nvsdata.formats.contents import Contents
from nvsdata.formats.records import stated_size
from nvsdata.formats.registry import Format, starts_with
from nvsdata.formats.writing import Pieces, file_with_header, stated_time, time_comment
from nvsdata.kernels.decode.aedat2 import DAVIS, DVS128, aedat2_decode

# camera (the end of the class name in `# AEChip:`): size, layout, and the class name that nvsdata writes
CHIPS = {
    "DVS128": ((128, 128), DVS128, "ch.unizh.ini.jaer.chip.retina.DVS128"),
    "DAVIS240": ((240, 180), DAVIS, "eu.seebetter.ini.chips.davis.DAVIS240C"),
    "DAVIS346": ((346, 260), DAVIS, "eu.seebetter.ini.chips.davis.Davis346red"),
}

_SENSOR = re.compile(r"# nvsdata sensor (\d+)x(\d+)")


class Aedat2Recording(ClockedFile):
    """An AEDAT 2.0 file. AEDAT 1.0 differs in the size of a record."""

    format = "aedat2"
    holds_samples = True
    record_size = 8

    def __init__(self, path: str, sensor_size: tuple[int, int] | None, head: bytes, strict: bool) -> None:
        contents = Contents(path, head)
        lines, end = contents.header(b"#")
        super().__init__(contents, sensor_size, strict, header_size=end)
        chip = next((m[1].upper() for line in lines if (m := re.match(r"#\s*AEChip:.*?(\w+)\s*$", line))), None)
        self.chip_size, self.layout = self._camera(chip)
        stated = self._size or self._stated(lines)
        # without the name of a chip, the addresses show which one it was
        self._guessed = stated is None and chip is None
        self._size = stated or self.chip_size
        self._state_times(stated_time(lines))
        self._scales = Scales.stated(lines)

    def _camera(self, chip: str | None) -> tuple[tuple[int, int], int]:
        """Return size and address layout of the chip: by the header, else by the sensor size, else by the addresses."""
        for name, (size, layout, _) in CHIPS.items():
            if chip is not None and chip.startswith(name):
                return size, layout
        if chip is not None:
            raise FormatError(
                self.path, f"recorded by an unknown camera, {chip}; known are {', '.join(CHIPS)}", offset=0
            )
        for size, layout, _ in CHIPS.values():
            if self._size == size:
                return size, layout
        # addresses of a DVS128 have 16 bits
        first = self._wide(self.contents.read(self._byte(0), self._byte(min(self.records, self.block))))
        name = "DVS128" if not first.reshape(-1, 8)[:, :2].any() else "DAVIS240"
        return CHIPS[name][:2]

    def _stated(self, lines: Sequence[str]) -> tuple[int, int] | None:
        """Return the sensor size that nvsdata's comment in a header states; None without one.

        FormatError if it exceeds the chip, which may be larger than the sensor of a file that nvsdata wrote.
        """
        found = next((m for line in lines if (m := _SENSOR.fullmatch(line.rstrip()))), None)
        if found is None:
            return None
        width, height = stated_size(self.path, *found.groups())
        if width > self.chip_size[0] or height > self.chip_size[1]:
            what = "{}x{}, more than the {}x{} of its chip".format(width, height, *self.chip_size)
            raise FormatError(self.path, f"the header states a sensor of {what}", offset=0)
        return width, height

    def _wide(self, raw: np.ndarray) -> np.ndarray:
        """Return records in the layout of AEDAT 2.0; a subclass converts them."""
        return raw

    def _times(self, raw: np.ndarray) -> np.ndarray:
        return self._wide(raw).view(">u4")[1::2].astype(np.uint32)

    def _piece(self, raw: np.ndarray, state: np.ndarray, kept: int, columns: Columns) -> tuple[int, int]:
        sizes = (*self.chip_size, *self.sensor_size)
        count, bad = aedat2_decode(self._wide(raw), self.block, self.layout, *sizes, state, kept, *columns)
        return count, bad

    def frames(self, start: int | None = None, stop: int | None = None) -> Iterator[Frame]:
        if not self.holds_samples:
            return super().frames(start, stop)
        if self.layout != DAVIS:
            return iter(())
        return within(davis_frames(self._timed(), self.chip_size), start, stop)

    def inertial(self, start: int | None = None, stop: int | None = None) -> Inertial:
        if not self.holds_samples:
            return super().inertial(start, stop)
        if self.layout != DAVIS:
            return Inertial.empty()
        return davis_inertial(self._timed(), self._scales).window(start, stop)


def write(pieces: Pieces, path: Path) -> None:
    """Write AEDAT 2.0 records of the smallest of DVS128, DAVIS240C and DAVIS346 that contains the sensor.

    ValueError for a larger sensor, and for times that a reader couldn't unwrap from 32 bits: a first time outside
    [0, 2^32 - 1) µs, a gap of 2^31 µs or more, or a gap of more than five minutes where the 32 bits wrap.
    """
    size, layout, name = chip_for(*pieces.sensor_size)
    more = WRITTEN.lines if layout == DAVIS else ()
    with file_with_header(path, pieces, partial(header_bytes, "2.0", name, more=more)) as file:
        records: Any
        for records in with_times_of_32_bits(merged_records(pieces, layout, size), "AEDAT 2.0"):
            file.write(records.raw.data)


def chip_for(width: int, height: int) -> tuple[tuple[int, int], Any, str]:
    """Return size, layout and name of the smallest chip that contains the sensor. ValueError if none does."""
    for chip in CHIPS.values():
        if width <= chip[0][0] and height <= chip[0][1]:
            return chip
    raise ValueError(f"AEDAT 2.0 is written for sensors up to 346x260, not {width}x{height}")


def header_bytes(version: str, chip: str, pieces: Pieces, more: Sequence[str] = ()) -> bytes:
    """Return the header of a file of AEDAT `version`, recorded by `chip`; `more` are further lines."""
    size = "# nvsdata sensor {}x{}".format(*pieces.sensor_size)
    lines = (f"#!AER-DAT{version}", "# Written by nvsdata", "# Timestamps tick is 1 us", f"# AEChip: {chip}", size)
    return "".join(f"{line}\r\n" for line in (*lines, *more, time_comment(pieces), "#End Of ASCII Header")).encode()


FORMAT = Format(
    "aedat2",
    (".aedat",),
    Aedat2Recording,
    begins=starts_with(b"#!AER-DAT2."),
    write=write,
    holds_samples=True,
)
