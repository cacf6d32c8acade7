"""AEDAT 1.0 (jAER, DVS128): like AEDAT 2.0 with addresses of 16 bits. The oldest files don't state a version."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np

from nvsdata.formats.aedat import aedat2
from nvsdata.formats.aedat.aedat2 import CHIPS, header_bytes
from nvsdata.formats.clocked import with_times_of_32_bits
from nvsdata.formats.contents import header_lines
from nvsdata.formats.registry import Format, starts_with
from nvsdata.formats.writing import Pieces, file_with_header
from nvsdata.kernels.decode.aedat2 import aedat2_encode
from nvsdata.kernels.decode.clock import WRAP_US


class Aedat1Recording(aedat2.Aedat2Recording):
    """An AEDAT 1.0 file."""

    format = "aedat1"
    holds_samples = False
    record_size = 6

    def _wide(self, raw: np.ndarray) -> np.ndarray:
        wide = np.zeros((raw.size // 6, 8), np.uint8)
        wide[:, 2:] = raw.reshape(-1, 6)
        return wide.reshape(-1)


def looks_like(head: bytes, _: int) -> bool:
    """Return whether a file that begins with `head` and states no version could be AEDAT 1.0: its times never fall.

    The file may be truncated.
    """
    if head.startswith(b"#!"):
        return False
    end = header_lines(head, b"#")[1]
    raw = np.frombuffer(head[end : end + 6 * 256], np.uint8)
    if raw.size < 6 * 16:
        return False
    t = np.ascontiguousarray(raw[: raw.size - raw.size % 6].reshape(-1, 6)[:, 2:]).view(">u4").astype(np.uint32)
    # the counter may wrap, so differences are taken modulo 2^32
    return bool(0 < np.diff(t, axis=0).sum(dtype=np.int64) < WRAP_US // 2)


def write(pieces: Pieces, path: Path) -> None:
    """Write AEDAT 1.0 records of a DVS128. ValueError for a larger sensor, and for the same times as in AEDAT 2.0."""
    size, layout, name = CHIPS["DVS128"]
    width, height = pieces.sensor_size
    if width > size[0] or height > size[1]:
        raise ValueError(f"AEDAT 1.0 is written for sensors up to 128x128, not {width}x{height}")
    with file_with_header(path, pieces, partial(header_bytes, "1.0", name)) as file:
        for events in with_times_of_32_bits(pieces, "AEDAT 1.0"):
            # the upper half of the address, which is 0, is left out
            records = aedat2_encode(*events.columns, layout, *size).view(np.uint8).reshape(-1, 8)
            file.write(np.ascontiguousarray(records[:, 2:]).data)


FORMAT = Format(
    "aedat1",
    (".aedat1", ".aedat"),
    Aedat1Recording,
    begins=starts_with(b"#!AER-DAT1."),
    looks_like=looks_like,
    write=write,
)
