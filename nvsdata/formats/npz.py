"""NumPy archives of events, `.npz`: an array for each of t, x, y and p, or a single array of events as in `.npy`.

spikingjelly writes arrays t, x, y and p; N-ImageNet has records in `event_data`. Names, units and polarities are those
of `.npy` files. Other arrays are ignored. Archives may be compressed; they are decoded as a whole.
"""

from __future__ import annotations

import errno
import os
import struct
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from zipfile import BadZipFile, ZipFile

import numpy as np

from nvsdata.common.errors import FormatError
from nvsdata.data.events import Columns
from nvsdata.formats.contents import Allowance
from nvsdata.formats.file_recording import FileRecording, as_integers, as_polarity
from nvsdata.formats.npy import check_events, column_of, fields_of, header_of, named, time_scale, times_of
from nvsdata.formats.registry import Format
from nvsdata.kernels.decode.order import is_sorted

END = ".npy"  # of the names of arrays in an archive
# errors of damaged archives, and of archives that are encrypted or need another compression
FAULTS = BadZipFile, zlib.error, struct.error, EOFError, RuntimeError, ValueError


class NpzRecording(FileRecording):
    """A `.npz` file of events; it doesn't state a sensor size."""

    format = "npz"

    def __init__(self, path: str, sensor_size: tuple[int, int] | None, head: bytes, strict: bool) -> None:
        super().__init__(path, sensor_size, strict)
        with self._opened() as archive:
            self._find(archive)

    @contextmanager
    def _opened(self) -> Iterator[ZipFile]:
        try:
            with ZipFile(self.path) as archive:
                yield archive
        except FormatError:
            raise
        except (*FAULTS, OSError) as error:
            # a damaged offset is an invalid argument; other errors are the disk's
            if isinstance(error, OSError) and error.errno != errno.EINVAL:
                raise
            raise FormatError(self.path, f"damaged archive: {str(error)[:100]}") from None

    def _find(self, archive: ZipFile) -> dict[str, str]:
        """Return the names of the arrays of t, x, y and p; of one array of all as "events"."""
        names = [name.removesuffix(END) for name in archive.namelist() if name.endswith(END)]
        found = named(names)
        if len(found) == 4:
            return found
        if len(names) == 1:
            return {"events": names[0]}
        # of several arrays, one may have the events
        events = [name for name in names if name.lower() in ("events", "event_data")]
        if len(events) != 1:
            raise FormatError(self.path, f"has the arrays {names[:9]}, not t, x, y and p, or a single one of events")
        return {"events": events[0]}

    def decode(self) -> Columns:
        with self._opened() as archive:
            left = Allowance(os.path.getsize(self.path))
            arrays = {key: self._array(archive, name, left) for key, name in self._find(archive).items()}
        if "events" in arrays:
            array = arrays["events"]
            check_events(self.path, array.shape, array.dtype)
            arrays = {name: column_of(array, field) for name, field in fields_of(self.path, array).items()}
        sizes = {name: array.shape for name, array in arrays.items()}
        if len({*sizes.values()}) != 1 or arrays["t"].ndim != 1 or any(array.dtype.fields for array in arrays.values()):
            raise FormatError(self.path, f"t, x, y and p aren't columns of one length: {sizes}")
        x, y, p = (as_integers(self.path, f"column {name!r}", arrays[name]) for name in "xyp")
        t = times_of(self.path, arrays["t"], time_scale(arrays["t"]))
        t, x, y, p = self._inside((t, x, y, as_polarity(p)))
        self._rises = is_sorted(t)
        return Columns(np.ascontiguousarray(t), x.astype(np.int16), y.astype(np.int16), p.astype(np.uint8))

    def _array(self, archive: ZipFile, name: str, left: Allowance) -> np.ndarray:
        """Return an array of the archive, of which no more is decompressed than `left` allows."""
        member = archive.getinfo(name + END)
        left.take(member.file_size)
        raw = archive.read(member)
        shape, transposed, kind, end = header_of(self.path, raw)
        if len(raw) - end != np.prod(shape, dtype=object) * kind.itemsize:
            raise FormatError(self.path, f"{name} has {len(raw) - end} bytes, not those of an array of shape {shape}")
        return np.frombuffer(raw, kind, offset=end).reshape(shape, order="F" if transposed else "C")


FORMAT = Format("npz", (".npz",), NpzRecording)
