"""HDF5 with compressed columns: a third of the disk, for several times the time to read.

The layout is that of `layouts.py`, which reads these files too, in chunks of 2^14 events, shuffled and deflated.
It takes 1.7 to 3.3 bytes per event where plain columns take 7 to 9.
A window of 30 ms takes milliseconds, not 0.1 ms.
"""

from __future__ import annotations

from functools import partial

from nvsdata.formats.hdf5.layouts import FORMAT as PLAIN
from nvsdata.formats.hdf5.writer import write
from nvsdata.formats.registry import Format

FORMAT = Format(
    "hdf5-gzip",
    PLAIN.suffixes,
    PLAIN.open,
    begins=PLAIN.begins,
    write=partial(write, compressed=True),
    holds_samples=True,
)
