"""AEDAT 1.0 (jAER, DVS128): as AEDAT 2.0, with addresses of 16 bits."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np

from nvsdata.events import Events
from nvsdata.formats import aedat2
from nvsdata.formats.aedat2 import CHIPS, header
from nvsdata.formats.records import with_times_of_32_bits
from nvsdata.kernels.aedat import aedat2_encode


class Recording(aedat2.Recording):
    """An AEDAT 1.0 file."""

    format = "aedat1"
    record_size = 6


def write(pieces: Iterable[Events], sensor_size: tuple[int, int], path: Path) -> None:
    """Write AEDAT 1.0 records of a DVS128. ValueError for a larger sensor, and times as for AEDAT 2.0."""
    size, layout, name = CHIPS["DVS128"]
    width, height = sensor_size
    if width > size[0] or height > size[1]:
        raise ValueError(f"AEDAT 1.0 is written for sensors up to 128x128, not {width}x{height}")
    with path.open("wb") as file:
        file.write(header("1.0", name))
        for events in with_times_of_32_bits(pieces, "AEDAT 1.0"):
            # the upper half of the address, which is 0, is left out
            records = aedat2_encode(*events.columns, layout, *size).view(np.uint8).reshape(-1, 8)
            file.write(np.ascontiguousarray(records[:, 2:]).tobytes())
