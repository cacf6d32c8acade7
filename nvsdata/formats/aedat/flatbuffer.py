"""Flatbuffers, as far as AEDAT 4 needs them: reads tables in place, and writes vectors of tables.

The package flatbuffers reads the rows of a table one by one in Python, which takes 60 to 100 times as long.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence

import numpy as np


class Table:
    """A table of a flatbuffer, whose fields are read on demand; struct.error or ValueError if it is damaged."""

    def __init__(self, data: memoryview, at: int) -> None:
        self.data, self.at = data, at
        self.fields = at - self._read("<i", at)

    @classmethod
    def root(cls, data: memoryview, start: int, name: bytes) -> Table:
        """Return the root table of the buffer at `start`, whose identifier must be `name`."""
        if bytes(data[start + 4 : start + 8]) != name:
            raise ValueError(f"no {name.decode()} but {bytes(data[start + 4 : start + 8])!r}")
        return cls(data, start + struct.unpack_from("<I", data, start)[0])

    def _read(self, kind: str, at: int) -> int:
        if at < 0:
            raise ValueError("an offset is before the buffer")
        value: int = struct.unpack_from(kind, self.data, at)[0]
        return value

    def _place(self, field: int) -> int:
        """Return the offset of a field; 0 if the table has no such field."""
        inside = 4 + 2 * field < self._read("<H", self.fields)
        offset = self._read("<H", self.fields + 4 + 2 * field) if inside else 0
        return self.at + offset if offset else 0

    def number(self, field: int, kind: str, default: int) -> int:
        """Return the number in a field, of the struct format `kind`; `default` if the table has no such field."""
        place = self._place(field)
        return self._read(kind, place) if place else default

    def vector(self, field: int) -> tuple[int, int]:
        """Return offset and length of the vector in a field; (0, 0) if the table has no such field."""
        place = self._place(field)
        if not place:
            return 0, 0
        place += self._read("<I", place)
        return place + 4, self._read("<I", place)

    def string(self, field: int) -> str:
        """Return the string in a field."""
        first, length = self.vector(field)
        if length > len(self.data) - first:
            raise ValueError(f"a string of {length} bytes beyond the buffer")
        return bytes(self.data[first : first + length]).decode("utf-8")


class Rows:
    """The tables in a vector, read together; `first` and `count` are from `Table.vector`. ValueError if damaged."""

    def __init__(self, data: memoryview, first: int, count: int) -> None:
        self.data = np.frombuffer(data, np.uint8)
        # each table has four bytes in the vector and at least four of its own; more tables would share theirs
        if first + 8 * count > self.data.size:
            raise ValueError(f"{count} tables in {self.data.size} bytes")
        slots = first + 4 * np.arange(count)
        self.at = slots + self._read("<u4", slots)
        self.fields = self.at - self._read("<i4", self.at)

    def _read(self, kind: str, places: np.ndarray) -> np.ndarray:
        size = np.dtype(kind).itemsize
        if places.size and not 0 <= places.min() <= places.max() <= self.data.size - size:
            raise ValueError("an offset is outside the buffer")
        # a view of the number at each offset
        numbers = np.ndarray((max(self.data.size - size + 1, 0),), kind, self.data, 0, (1,))
        found: np.ndarray = numbers[places]
        return found

    def column(self, field: int, kind: str, inside: int = 0) -> np.ndarray:
        """Return the numbers in a field, of the dtype `kind` (0 if missing); `inside` is an offset in a struct."""
        entry = 4 + 2 * field
        offset = np.zeros(self.at.size, np.int64)
        has = entry < self._read("<u2", self.fields)
        offset[has] = self._read("<u2", self.fields[has] + entry)
        has = offset > 0
        numbers = np.zeros(self.at.size, kind)
        numbers[has] = self._read(kind, (self.at + offset)[has] + inside)
        return numbers


def layout_of(size: int, places: Sequence[int]) -> bytes:
    """Return the layout (vtable) of a table of `size` bytes with fields at the offsets `places` (0 for no field)."""
    packed = struct.pack(f"<{len(places) + 2}H", 4 + 2 * len(places), size, *places)
    # padding aligns the next object
    return packed + bytes(-len(packed) % 8)


def packed_vector(name: bytes, rows: np.ndarray, layout: bytes) -> bytes:
    """Return a flatbuffer, preceded by its length, whose root has one field, a vector of tables.

    The column "way" of `rows` is overwritten with the offset of each table's layout.
    """
    # offsets count from the length; the rows and their layout are aligned
    slots = 32 + 4 * np.arange(rows.size + 1)
    begin = int(slots[-1] + -slots[-1] % 8)
    at = begin + len(layout) + rows.dtype.itemsize * np.arange(rows.size)
    rows["way"] = at - begin
    ways = (at - slots[:-1]).astype("<u4").tobytes()
    flat = struct.pack("<I4s3H2xiII", 16, name, 6, 8, 4, 8, 4, rows.size) + ways
    flat += bytes(begin - 4 - len(flat)) + layout + rows.tobytes()
    return struct.pack("<I", len(flat)) + flat
