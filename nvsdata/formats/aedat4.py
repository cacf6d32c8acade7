"""AEDAT 4 (iniVation DV), with the packages lz4 and zstandard (extra `aedat4`).

A file begins with `#!AER-DAT4.0` CR LF, the length of a flatbuffer, and that flatbuffer: the compression, the place of
a table at the end, and XML that names the streams. Packets follow: stream and size as int32, then a flatbuffer,
compressed as a whole. A packet of events holds a vector of 16-byte structs with times in µs. Only the first stream of
events is read. The times of a packet are not known before it is inflated, so a window decodes the whole file.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator
from typing import Any
from xml.etree import ElementTree

import numpy as np

from nvsdata.common.errors import FormatError
from nvsdata.data.events import LATEST, Columns
from nvsdata.formats.contents import Contents
from nvsdata.formats.file_recording import FileRecording
from nvsdata.formats.records import stated_size
from nvsdata.formats.registry import Format, starts_with

MAGIC = 14  # bytes
EVENT = np.dtype([("t", "<i8"), ("x", "<i2"), ("y", "<i2"), ("on", "u1"), ("unused", "V3")])
EVENTS = ("t", "x", "y", "on")
LZ4, ZSTD = (1, 2), (3, 4)
MAX_INFLATED = 1 << 30  # bytes that a packet may inflate to


class Aedat4Recording(FileRecording):
    """An AEDAT 4 file."""

    format = "aedat4"

    def __init__(self, path: str, sensor_size: tuple[int, int] | None, head: bytes, strict: bool) -> None:
        super().__init__(path, sensor_size, strict)
        self._contents = Contents(path, head)
        try:
            (length,) = struct.unpack_from("<I", head, MAGIC)
            self._first = MAGIC + 4 + length
            if self._first > self._contents.size:
                raise FormatError(path, f"truncated: a header of {length} bytes", offset=MAGIC)
            header = _Table.root(self._contents.read(MAGIC + 4, self._first).data, 0, b"IOHE")
            self._inflate = self._inflater(header.number(0, "<i", 0))
            end = header.number(1, "<q", -1)
            self._end = end if self._first <= end <= self._contents.size else self._contents.size
            streams = ElementTree.fromstring(header.string(2))
            self._stream, stated = _events_stream(streams)
        except (struct.error, ValueError, IndexError, ElementTree.ParseError) as error:
            raise error if isinstance(error, FormatError) else self._fault(MAGIC, error) from error
        if self._size is None and stated is not None:
            self._size = stated_size(path, *stated)
        self._contents.let_go()

    def _fault(self, at: int, error: BaseException) -> FormatError:
        return FormatError(self.path, f"damaged AEDAT 4: {error}", offset=at)

    def _inflater(self, compression: int) -> Callable[[memoryview], bytes]:
        try:
            if compression in LZ4:
                import lz4.frame

                return lambda packet: bytes(lz4.frame.decompress(packet))
            if compression in ZSTD:
                import zstandard

                return lambda packet: _unzstd(zstandard, packet)
        except ImportError as error:
            reason = f"{self.path}: AEDAT 4 needs the packages lz4 and zstandard: pip install 'nvsdata[aedat4]'"
            raise ImportError(reason) from error
        if compression:
            raise ValueError(f"unknown compression {compression}")
        return bytes

    def _packets(self) -> Iterator[tuple[int, memoryview]]:
        """Byte offset and content of the packets of the stream of events."""
        data, at = self._contents.read(self._first, self._end).data, self._first
        while at + 8 <= self._end:
            stream, size = struct.unpack_from("<ii", data, at - self._first)
            if not 0 <= size <= self._end - at - 8:
                raise FormatError(
                    self.path, f"truncated: a packet of {size} bytes, {self._end - at - 8} are left", offset=at
                )
            if stream == self._stream:
                yield at, data[at + 8 - self._first : at + 8 + size - self._first]
            at += 8 + size
        if at < self._end:
            raise FormatError(self.path, f"truncated: {self._end - at} bytes are left over", offset=at)

    def decode(self) -> Columns:
        parts: list[np.ndarray] = []
        try:
            for at, packet in self._packets():
                parts.append(self._events_of(at, packet))
        except FormatError:
            if self.strict or not parts:
                raise
            self._repair("packets from the first damaged one on, cut off", 1)
        if not parts:
            return Columns.empty(0)
        events = self._timed(np.concatenate(parts))
        return Columns(*(np.ascontiguousarray(column) for column in self._inside([events[name] for name in EVENTS])))

    def _timed(self, events: np.ndarray) -> np.ndarray:
        """The events whose times Events can hold."""
        late = (events["t"] <= -LATEST) | (events["t"] >= LATEST)
        if not late.any():
            return events
        if self.strict:
            raise FormatError(self.path, f"event {int(np.argmax(late))}: a time at or beyond 2^62 µs")
        self._repair("events at or beyond 2^62 µs, dropped", int(np.count_nonzero(late)))
        return events[~late]

    def _events_of(self, at: int, packet: memoryview) -> np.ndarray:
        try:
            payload = memoryview(self._inflate(packet))
            first, count = _Table.root(payload, 4, b"EVTS").vector(0)
            if count * EVENT.itemsize > len(payload) - first:
                raise ValueError(f"{count} events in {len(payload)} bytes")
            return np.frombuffer(payload, EVENT, count, first)
        except Exception as error:  # lz4 and zstandard raise their own errors
            raise self._fault(at, error) from error


class _Table:
    """A table of a flatbuffer: gives its fields. struct.error or ValueError if it is broken."""

    def __init__(self, data: memoryview, at: int) -> None:
        self.data, self.at = data, at
        self.fields = at - self._read("<i", at)

    @classmethod
    def root(cls, data: memoryview, start: int, name: bytes) -> _Table:
        """The table that the buffer at `start` begins with; its identifier must be `name`."""
        if bytes(data[start + 4 : start + 8]) != name:
            raise ValueError(f"no {name.decode()} but {bytes(data[start + 4 : start + 8])!r}")
        return cls(data, start + struct.unpack_from("<I", data, start)[0])

    def _read(self, kind: str, at: int) -> int:
        if at < 0:
            raise ValueError("an offset that leads before the buffer")
        value: int = struct.unpack_from(kind, self.data, at)[0]
        return value

    def _place(self, field: int) -> int:
        """Byte at which a field lies; 0 if the table has no such field."""
        inside = 4 + 2 * field < self._read("<H", self.fields)
        offset = self._read("<H", self.fields + 4 + 2 * field) if inside else 0
        return self.at + offset if offset else 0

    def number(self, field: int, kind: str, default: int) -> int:
        """The number in a field, of the struct format `kind`; `default` if the table has no such field."""
        place = self._place(field)
        return self._read(kind, place) if place else default

    def vector(self, field: int) -> tuple[int, int]:
        """First byte and length of the vector in a field; (0, 0) if the table has no such field."""
        place = self._place(field)
        if not place:
            return 0, 0
        place += self._read("<I", place)
        return place + 4, self._read("<I", place)

    def string(self, field: int) -> str:
        """The string in a field."""
        first, length = self.vector(field)
        if length > len(self.data) - first:
            raise ValueError(f"a string of {length} bytes beyond the buffer")
        return bytes(self.data[first : first + length]).decode("utf-8")


def _events_stream(root: Any) -> tuple[int, tuple[str, str] | None]:
    """Number of the first stream of events, and the width and height of its sensor."""
    for node in root.iter("node"):
        attributes = {attr.get("key"): attr.text or "" for attr in node.findall("attr")}
        if attributes.get("typeIdentifier") != "EVTS":
            continue
        inner = {attr.get("key"): attr.text or "" for info in node.findall("node") for attr in info.findall("attr")}
        stated = (inner["sizeX"], inner["sizeY"]) if "sizeX" in inner and "sizeY" in inner else None
        return int(node.get("name", "")), stated
    raise ValueError("no stream of events")


def _unzstd(zstandard: Any, packet: memoryview) -> bytes:
    size = zstandard.get_frame_parameters(packet).content_size
    if MAX_INFLATED < size < (1 << 64) - 2:  # the two largest values mean that it isn't known
        raise ValueError(f"a packet that inflates to {size} bytes")
    inflated: bytes = zstandard.ZstdDecompressor().decompress(packet, max_output_size=MAX_INFLATED)
    return inflated


FORMAT = Format("aedat4", (".aedat4", ".aedat"), Aedat4Recording, begins=starts_with(b"#!AER-DAT4."))
