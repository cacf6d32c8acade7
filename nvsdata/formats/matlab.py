"""MATLAB `.mat`, v5 and v7.3: columns `ts`, `x`, `y`, `pol` (ASL-DVS, UCF101-DVS, ASLAN-DVS).

v5 is a sequence of tagged elements, which are usually compressed one by one with zlib; v7.3 is HDF5. Columns may be of
any numeric type, and may be fields of a struct. Polarity may be 0/1 or -1/1. Coordinates that count from 1 are
recognized by a value that equals the sensor's width or height, and are shifted.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Iterator
from itertools import islice

import numpy as np

from nvsdata.common.errors import FormatError
from nvsdata.data.events import Columns
from nvsdata.formats.contents import Allowance, Contents, fast_zlib, most_bytes
from nvsdata.formats.file_recording import FileRecording, as_integers, as_polarity
from nvsdata.formats.registry import Format

NAMES = {"t": ("ts", "t"), "x": ("x",), "y": ("y",), "p": ("pol", "p")}
HEADER = 128
COMPRESSED, MATRIX = 15, 14
_CODES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
NUMBERS = {kind: np.dtype(f"<{code}") for kind, code in _CODES.items()}
NUMERIC_CLASSES = range(6, 16)  # double, single and the integer types
MOST_FIELDS = 4096  # fields of a struct
_TAG = struct.Struct("<II").unpack_from


class MatlabRecording(FileRecording):
    """A MATLAB file of events; it doesn't state a sensor size."""

    format = "matlab"

    def __init__(self, path: str, sensor_size: tuple[int, int] | None, head: bytes, strict: bool) -> None:
        super().__init__(path, sensor_size, strict)
        self._contents = Contents(path, head)
        self._v73_signed = head[512:520] == b"\x89HDF\r\n\x1a\n"

    def decode(self) -> Columns:
        found = self._v73() if self._v73_signed else self._v5()
        columns = {}
        for name, known in NAMES.items():
            column = next((found[key] for key in known if key in found), None)
            if column is None:
                raise FormatError(self.path, f"no variable {known[0]!r}; the file has {sorted(found)}")
            columns[name] = column.reshape(-1)
        lengths = {name: column.size for name, column in columns.items()}
        if len(set(lengths.values())) != 1:
            raise FormatError(self.path, f"columns of different lengths: {lengths}")
        return self._checked(columns)

    def _checked(self, columns: dict[str, np.ndarray]) -> Columns:
        t, x, y, p = (as_integers(self.path, f"variable {name!r}", columns[name]) for name in ("t", "x", "y", "p"))
        width, height = self._limits
        if (_greatest(x) == width or _greatest(y) == height) and x.min() >= 1 and y.min() >= 1:
            x, y = x.astype(np.int64) - 1, y.astype(np.int64) - 1
        t, x, y, p = self._inside((t, x, y, as_polarity(p)))
        return Columns(t.astype(np.int64), x.astype(np.int16), y.astype(np.int16), p.astype(np.uint8))

    def _v5(self) -> dict[str, np.ndarray]:
        data = self._contents.read(0, self._contents.size).data
        if bytes(data[124:128]) != b"\x00\x01IM":
            raise FormatError(self.path, "not a little-endian MATLAB v5 file, or truncated", offset=124)
        found: dict[str, np.ndarray] = {}
        left = most_bytes(len(data))
        for at, kind, body in self._elements(data, HEADER):
            if kind == COMPRESSED:
                body = self._inflated(at, body, left)
                left -= len(body)
                kind = int.from_bytes(body[:4], "little")
                body = body[8:]
            if kind == MATRIX:
                self._matrix(at, body, found)
        return found

    def _elements(self, data: memoryview, at: int) -> Iterator[tuple[int, int, memoryview]]:
        """Yield offset, type and body of each tagged element from byte `at` on."""
        while at + 8 <= len(data):
            kind, size = _TAG(data, at)
            if kind >> 16:  # small element: the size is in the upper half, and up to four bytes follow
                yield at, kind & 0xFFFF, data[at + 4 : at + 4 + min(kind >> 16, 4)]
                at += 8
                continue
            if size > len(data) - at - 8:
                raise FormatError(
                    self.path, f"truncated: an element of {size} bytes, {len(data) - at - 8} are left", offset=at
                )
            yield at, kind, data[at + 8 : at + 8 + size]
            at += 8 + (size if kind == COMPRESSED else -(-size // 8) * 8)

    def _inflated(self, at: int, body: memoryview, left: int) -> memoryview:
        """Decompress an element. FormatError as soon as it exceeds `left` bytes."""
        inflater = fast_zlib.decompressobj()
        try:
            inflated = inflater.decompress(body, left + 1)
        except fast_zlib.error as error:
            raise FormatError(self.path, f"damaged compressed element: {error}", offset=at) from None
        if len(inflated) > left:
            size = self._contents.size
            reason = f"expands too far: a file of {size} bytes may expand to {most_bytes(size)} at most"
            raise FormatError(self.path, reason, offset=at)
        if not inflater.eof or len(inflated) < 8:
            raise FormatError(self.path, "a compressed element is truncated", offset=at)
        return memoryview(inflated)

    def _matrix(self, at: int, body: memoryview, found: dict[str, np.ndarray], prefix: str | None = None) -> None:
        """Add a numeric matrix, or the numeric fields of a struct, to `found` by name."""
        elements = ((kind, part) for _, kind, part in self._elements(body, 0))
        parts = list(islice(elements, 4))
        if len(parts) < 4 or len(parts[0][1]) < 8:
            return
        category = parts[0][1][0]
        name = prefix or bytes(parts[2][1]).decode("latin-1")
        if category == 2 and prefix is None and len(parts[3][1]) == 4:
            length = max(int.from_bytes(parts[3][1], "little"), 1)
            _, names = next(elements, (0, memoryview(b"")))
            starts = range(0, min(len(names), MOST_FIELDS * length), length)
            for start, (_, part) in zip(starts, elements, strict=False):
                field = bytes(names[start : start + length]).split(b"\0")[0].decode("latin-1")
                self._matrix(at, part, found, field)
        elif category in NUMERIC_CLASSES:
            kind, numbers = parts[3]
            if kind not in NUMBERS or len(numbers) % NUMBERS[kind].itemsize:
                raise FormatError(self.path, f"variable {name!r} is of an unknown type", offset=at)
            found[name] = np.frombuffer(numbers, NUMBERS[kind])

    def _v73(self) -> dict[str, np.ndarray]:
        # imported here, because h5py takes 35 ms
        import h5py

        from nvsdata.formats.hdf5.chunks import values_of
        from nvsdata.formats.hdf5.file import check_stored, found_in, opened

        wanted = {name for names in NAMES.values() for name in names}
        found: dict[str, np.ndarray] = {}
        left = Allowance(self._contents.size)
        with opened(self.path, "damaged MATLAB v7.3 file") as file:
            root = h5py.h5g.open(file.id, b"/")
            # structs are groups; names that begin with # are MATLAB's own
            names = [name for name in root if not name.startswith(b"#")]
            groups = [n for n in names if h5py.h5g.get_objinfo(root, n, False).type == h5py.h5g.GROUP]
            for place in (root, *(h5py.h5g.open(root, name) for name in groups)):
                for name in (name.decode("latin-1") for name in place):
                    if name not in wanted:
                        # only the names of other variables are needed, for error messages
                        found.setdefault(name, np.empty(0))
                        continue
                    item = found_in(self.path, place, name)
                    if isinstance(item, h5py.h5d.DatasetID):
                        check_stored(self.path, item, left)
                        if item.dtype.kind in "iufb":
                            found[name] = values_of(self.path, h5py.Dataset(item))
        return found


def _greatest(column: np.ndarray) -> int:
    """Return the greatest value, 0 for an empty column."""
    return int(column.max()) if column.size else 0


FORMAT = Format("matlab", (".mat",), MatlabRecording, begins=re.compile(rb"MATLAB [57]\.\d MAT-file").match)
