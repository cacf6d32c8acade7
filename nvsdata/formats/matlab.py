"""MATLAB `.mat`, v5 and v7.3: columns `ts`, `x`, `y`, `pol` (ASL-DVS, UCF101-DVS, ASLAN-DVS).

v5 is a row of tagged elements, each usually compressed by zlib by itself; v7.3 is HDF5. Columns may
be of any numeric type and may lie in a struct; polarity may be 0/1 or -1/1. Coordinates counted
from 1 are told by a value that equals the sensor's width or height, and shifted.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from typing import Any

import h5py
import numpy as np

from nvsdata.errors import FormatError
from nvsdata.events import MAX_COORDINATE, Columns
from nvsdata.events import Recording as BaseRecording
from nvsdata.formats.records import bytes_of

NAMES = {"t": ("ts", "t"), "x": ("x",), "y": ("y",), "p": ("pol", "p")}
HEADER = 128
COMPRESSED, MATRIX = 15, 14
NUMBERS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
NUMERIC_CLASSES = range(6, 16)  # double, single and the integers
MOST = 1 << 32  # bytes that an element may inflate to


class Recording(BaseRecording):
    """A MATLAB file of events; it holds no sensor size."""

    format = "matlab"

    def __init__(self, path: str, sensor_size: tuple[int, int] | None, head: bytes, strict: bool) -> None:
        super().__init__(path, sensor_size, strict)
        self._head = head

    def _decode(self) -> Columns:
        found = self._v73() if self._head[512:520] == b"\x89HDF\r\n\x1a\n" else self._v5()
        columns = {}
        for name, known in NAMES.items():
            column = next((found[key] for key in known if key in found), None)
            if column is None:
                raise FormatError(self.path, None, f"no variable {known[0]!r}; it holds {sorted(found)}")
            columns[name] = column.reshape(-1)
        lengths = {name: column.size for name, column in columns.items()}
        if len(set(lengths.values())) != 1:
            raise FormatError(self.path, None, f"columns of different lengths: {lengths}")
        return self._checked(columns)

    def _checked(self, columns: dict[str, np.ndarray]) -> Columns:
        whole = {name: self._integers(name, column) for name, column in columns.items()}
        t, x, y, p = whole["t"], whole["x"], whole["y"], whole["p"]
        p = np.where(p == -1, 0, p)
        width, height = self._size or (MAX_COORDINATE + 1, MAX_COORDINATE + 1)
        if x.size and x.min() >= 1 and y.min() >= 1 and (x.max() == width or y.max() == height):
            x, y = x - 1, y - 1
        bad = (x < 0) | (x >= width) | (y < 0) | (y >= height) | (p < 0) | (p > 1)
        if bad.any():
            if self.strict:
                reason = f"event {int(np.argmax(bad))}: outside the sensor of {width}x{height}, or no polarity"
                raise FormatError(self.path, None, reason)
            self._repair("events outside the sensor, dropped", int(np.count_nonzero(bad)))
            t, x, y, p = (column[~bad] for column in (t, x, y, p))
        return Columns(t, x.astype(np.int16), y.astype(np.int16), p.astype(np.uint8))

    def _integers(self, name: str, column: np.ndarray) -> np.ndarray:
        """As int64 (times, whatever they are stored as) or int32; FormatError for fractions."""
        kind = np.int64 if name == "t" else np.int32
        if column.dtype.kind == "f":
            limit = 2.0**62 if name == "t" else 2.0**31
            # NaN fails the comparison, too
            if not (np.abs(column) < limit).all() or (column != np.rint(column)).any():
                raise FormatError(self.path, None, f"variable {name!r} holds numbers that aren't whole")
        elif (
            column.dtype.itemsize == 8 and column.size and not -(2**62) < int(column.min()) <= int(column.max()) < 2**62
        ):
            raise FormatError(self.path, None, f"variable {name!r} holds numbers beyond 2^62")
        return column.astype(kind, copy=False) if name == "t" else np.clip(column, -(2**31), 2**31 - 1).astype(kind)

    def _v5(self) -> dict[str, np.ndarray]:
        data = memoryview(bytes_of(self.path, self._head))
        if bytes(data[124:128]) != b"\x00\x01IM":
            raise FormatError(self.path, 124, "no little-endian MATLAB v5 file, or truncated")
        found: dict[str, np.ndarray] = {}
        for at, kind, body in self._elements(data, HEADER):
            if kind == COMPRESSED:
                body = self._inflated(at, body)
                kind = int.from_bytes(body[:4], "little")
                body = body[8:]
            if kind == MATRIX:
                self._matrix(at, body, found)
        return found

    def _elements(self, data: memoryview, at: int) -> Iterator[tuple[int, int, memoryview]]:
        """Offset, type and body of the tagged elements from byte `at`."""
        while at + 8 <= len(data):
            kind, size = struct.unpack_from("<II", data, at)
            if kind >> 16:  # the size in the upper half, up to four bytes right behind it
                yield at, kind & 0xFFFF, data[at + 4 : at + 4 + min(kind >> 16, 4)]
                at += 8
                continue
            if size > len(data) - at - 8:
                raise FormatError(
                    self.path, at, f"truncated: an element of {size} bytes, {len(data) - at - 8} are left"
                )
            yield at, kind, data[at + 8 : at + 8 + size]
            at += 8 + (size if kind == COMPRESSED else -(-size // 8) * 8)

    def _inflated(self, at: int, body: memoryview) -> memoryview:
        # the size stands at the head of the inflated bytes: with it they are made in one go
        try:
            inflater = zlib.decompressobj()
            start = inflater.decompress(body, 8)
            size = int.from_bytes(start[4:8], "little") if len(start) == 8 else 0
            if not 0 < size <= MOST:
                raise FormatError(self.path, at, "a compressed element without a body")
            return memoryview(zlib.decompress(body, bufsize=size + 8))
        except zlib.error as error:
            raise FormatError(self.path, at, f"damaged compressed element: {error}") from None

    def _matrix(self, at: int, body: memoryview, found: dict[str, np.ndarray], prefix: str | None = None) -> None:
        """Add a numeric matrix, or the fields of a struct of such, to `found` under its name."""
        parts = [(kind, part) for _, kind, part in self._elements(body, 0)]
        if len(parts) < 4 or len(parts[0][1]) < 8:
            return
        category = parts[0][1][0]
        name = prefix or bytes(parts[2][1]).decode("latin-1")
        if category == 2 and prefix is None and len(parts[3][1]) == 4:
            length = max(int.from_bytes(parts[3][1], "little"), 1)
            names = bytes(parts[4][1])
            fields = [names[i : i + length].split(b"\0")[0].decode("latin-1") for i in range(0, len(names), length)]
            for field, (_, part) in zip(fields, parts[5:], strict=False):
                self._matrix(at, part, found, field)
        elif category in NUMERIC_CLASSES:
            kind, numbers = parts[3]
            if kind not in NUMBERS or len(numbers) % np.dtype(NUMBERS[kind]).itemsize:
                raise FormatError(self.path, at, f"variable {name!r} is of an unknown type")
            found[name] = np.frombuffer(numbers, f"<{NUMBERS[kind]}")

    def _v73(self) -> dict[str, np.ndarray]:
        found: dict[str, np.ndarray] = {}

        def add(path: str, item: Any) -> None:
            if isinstance(item, h5py.Dataset) and item.dtype.kind in "iufb":
                found[path.rsplit("/", 1)[-1]] = np.asarray(item[()])

        try:
            with h5py.File(self.path, "r") as file:
                file.visititems(add)
        except (OSError, RuntimeError) as error:
            raise FormatError(self.path, None, f"damaged MATLAB v7.3 file: {error}") from error
        return found
