"""HDF5 files of events: the layouts that are read, and nvsdata's own, which is written.

The modules of this package are imported when a file is opened or written, because importing h5py takes 35 ms.
"""

from __future__ import annotations

from functools import partial
from pathlib import Path

from nvsdata.data.recording import Recording
from nvsdata.formats.registry import Format, starts_with
from nvsdata.formats.writing import Pieces


def _open(path: str, sensor_size: tuple[int, int] | None, head: bytes, strict: bool) -> Recording:
    from nvsdata.formats.hdf5.layouts import Hdf5Recording

    return Hdf5Recording(path, sensor_size, head, strict)


def _write(pieces: Pieces, path: Path, *, compressed: bool = False) -> None:
    from nvsdata.formats.hdf5.writer import write

    write(pieces, path, compressed=compressed)


FORMAT = Format(
    "hdf5",
    (".h5", ".hdf5"),
    _open,
    begins=starts_with(b"\x89HDF\r\n\x1a\n"),
    write=_write,
    holds_samples=True,
    packages=("hdf5plugin",),
)
# the same layout with compressed columns, which the same code reads: 1.7 to 3.3 bytes per event instead of 7 to 9; but
# reading a window of 30 ms takes milliseconds instead of 0.1 ms
COMPRESSED = Format(
    "hdf5-gzip",
    FORMAT.suffixes,
    FORMAT.open,
    begins=FORMAT.begins,
    write=partial(_write, compressed=True),
    holds_samples=True,
)
