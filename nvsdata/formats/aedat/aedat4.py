"""AEDAT 4 (iniVation DV), with the packages lz4 and zstandard (extra `aedat4`).

A file begins with `#!AER-DAT4.0` CR LF, the length of a flatbuffer, and that flatbuffer: the compression, the offset of
a table at the end, and XML that names the streams. Packets follow: stream and size as int32, then a compressed
flatbuffer. A packet of events has a vector of structs of 16 bytes, with times in µs. Only the first stream of each type
is read. The table states the times of each packet, so a window decompresses only the packets that overlap it.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator, Mapping
from functools import cached_property
from typing import Any, TypeVar
from xml.etree import ElementTree

import numpy as np

from nvsdata.common.errors import FormatError
from nvsdata.data.events import LATEST, Columns, check_window, concatenate
from nvsdata.data.samples import Frame, Inertial, Triggers, within
from nvsdata.formats import index_cache
from nvsdata.formats.aedat.aedat4_packets import EVENT, HEADER, MAGIC, PACKET, Packets, inflater, packets_of
from nvsdata.formats.aedat.aedat4_samples import LONG, unpack_frame, unpack_inertial, unpack_triggers
from nvsdata.formats.aedat.aedat4_writer import SOURCE, write
from nvsdata.formats.aedat.flatbuffer import Table
from nvsdata.formats.contents import MOST_HEADER, Allowance, Contents, most_bytes
from nvsdata.formats.file_recording import FileRecording
from nvsdata.formats.records import stated_size
from nvsdata.formats.registry import Format, starts_with
from nvsdata.formats.writing import stated_time
from nvsdata.kernels.decode.aedat4 import aedat4_decode
from nvsdata.kernels.decode.order import is_sorted

EVENTS = ("t", "x", "y", "on")
Packed = TypeVar("Packed")


class Aedat4Recording(FileRecording):
    """An AEDAT 4 file. The first window decodes the entire file if not `strict`, or if a small file has no table."""

    format = "aedat4"
    holds_triggers = True
    _cached = False  # whether the list of packets is a cached one
    _ends_checked = False  # whether the first and the last packet agree with the table

    def __init__(self, path: str, sensor_size: tuple[int, int] | None, head: bytes, strict: bool) -> None:
        super().__init__(path, sensor_size, strict)
        self._contents = Contents(path, head)
        begin = len(MAGIC)
        try:
            (length,) = struct.unpack_from("<I", head, begin)
            self._first = begin + 4 + length
            if self._first > self._contents.size:
                raise FormatError(path, f"truncated: a header of {length} bytes", offset=begin)
            if length > MOST_HEADER:
                raise FormatError(path, f"a header of {length} bytes, more than {MOST_HEADER}", offset=begin)
            header = Table.root(self._contents.read(begin + 4, self._first).data, 0, b"IOHE")
            self._inflate = inflater(path, header.number(0, "<i", 0))
            end = header.number(1, "<q", -1)
            self._end = end if self._first <= end <= self._contents.size else self._contents.size
            self._streams = _streams(ElementTree.fromstring(header.string(2)))
        except (struct.error, ValueError, IndexError, ElementTree.ParseError) as error:
            raise error if isinstance(error, FormatError) else self._fault(begin, error) from error
        self._stated = self._streams["EVTS"][1]
        if self._size is None and "sizeX" in self._stated and "sizeY" in self._stated:
            self._size = stated_size(path, self._stated["sizeX"], self._stated["sizeY"])
        self._state_times(stated_time([self._stated.get("time", "")]))
        self._listed: dict[str, Packets | None] = {}
        self._contents.drop_head()

    @property
    def holds_samples(self) -> bool:  # type: ignore[override]
        """True if the file has a stream of frames or inertial samples."""
        return "FRME" in self._streams or "IMUS" in self._streams

    @property
    def about(self) -> Mapping[str, Any]:
        source = self._stated.get("source", SOURCE)
        return {} if source == SOURCE else {"camera": source}

    def _fault(self, at: int, error: BaseException) -> FormatError:
        return FormatError(self.path, f"damaged AEDAT 4: {error}", offset=at)

    def _packets(self, kind: str) -> Iterator[tuple[int, memoryview]]:
        """Yield byte offset and content of the packets of a stream, in the file's order."""
        data, at = self._contents.read(self._first, self._end).data, self._first
        while at + HEADER <= self._end:
            stream, size = struct.unpack_from(PACKET, data, at - self._first)
            left = self._end - at - HEADER
            if not 0 <= size <= left:
                raise FormatError(self.path, f"truncated: a packet of {size} bytes, {left} are left", offset=at)
            begin = at + HEADER - self._first
            if stream == self._streams[kind][0]:
                yield at, data[begin : begin + size]
            at += HEADER + size
        if at < self._end:
            raise FormatError(self.path, f"truncated: {self._end - at} bytes are left over", offset=at)

    def _table(self, kind: str) -> Packets | None:
        """Return the packets of a stream, as the table at the file's end lists them; None without a valid table.

        In a large file without a table, the packets of events are found by a pass over the file.
        """
        if kind not in self._listed:
            listed = self._file_table
            found = None if listed is None else listed.of(self._streams[kind][0])
            self._listed[kind] = self._cached_or_scanned() if found is None and kind == "EVTS" else found
        return self._listed[kind]

    def _cached_or_scanned(self) -> Packets | None:
        """Return the packets of events of a large file without a table, from the cache or by a pass over it."""
        stamp = self._contents.stamp
        if not self.strict or stamp is None or stamp[0] < index_cache.LEAST:
            return None
        about: dict[str, object] = {"format": self.format, "stamp": stamp, "ends": "in order"}
        kept = (index_cache.load_index(self.path, about, stamp[0]) or {}).get("packets")
        if kept is not None and self._fits(kept):
            self._cached = True
            return Packets(*kept)
        rows, left = [], self._allowance
        for at, packet in self._packets("EVTS"):
            t = self._content(at, packet, _events_of, left)["t"]
            if t.size:
                # a packet out of order is listed with its end before its start, so that `ordered` is false
                ends = (t[0], t[-1]) if is_sorted(t.astype(np.int64)) else (1, 0)
                rows.append((self._streams["EVTS"][0], at + HEADER, len(packet), t.size, *ends))
        packets = np.array(rows, np.int64).reshape(-1, len(Packets._fields)).T
        index_cache.save_index(self.path, about, max(stamp[1:3]), {"packets": packets})
        return Packets(*packets)

    def _fits(self, kept: np.ndarray) -> bool:
        """Return whether a cached index may belong to this file; some of its packets are compared with the file."""
        if kept.dtype != np.int64 or kept.ndim != 2 or len(kept) != len(Packets._fields):
            return False
        packets = Packets(*kept)
        edges = np.stack((packets.at - HEADER, packets.at + packets.size), 1).ravel()
        inside = not edges.size or (edges[0] >= self._first and edges[-1] <= self._end and is_sorted(edges))
        if not (inside and (packets.size > 0).all() and (packets.elements > 0).all()):
            return False
        some_packets, left = packets.take(index_cache.entries_to_compare(packets.at.size)), self._allowance
        try:
            heads = [self._contents.read(at - HEADER, at).view("<i4").tolist() for at in some_packets.at.tolist()]
            if heads != np.stack((some_packets.stream, some_packets.size), 1).tolist():
                return False
            parts = [self._content(at, packet, _events_of, left) for at, packet in self._chosen(some_packets)]
        except FormatError:
            return False
        # for packets out of order, the index doesn't have the true times
        return self._agree(some_packets, parts) or not packets.ordered

    @cached_property
    def _file_table(self) -> Packets | None:
        """The packets of all streams, as the table at the file's end lists them; None if it is missing or invalid."""
        if not self.strict or self._end == self._contents.size:
            return None
        try:
            packed = self._contents.read(self._end, self._contents.size)
            table = self._inflate(packed.data, most_bytes(packed.size))
            found = packets_of(memoryview(table), self._first, self._end)
        except Exception:  # lz4 and zstandard raise their own errors
            return None
        # a wrong stream number would hide a packet
        places = [(at - HEADER, at) for at in found.at.tolist()]
        heads = b"".join(head.tobytes() for head in self._contents.ranges(places))
        same = np.array_equal(np.frombuffer(heads, "<i4").reshape(-1, 2), np.stack((found.stream, found.size), 1))
        return found if same else None

    def _chosen(self, packets: Packets) -> Iterator[tuple[int, memoryview]]:
        """Yield byte offset and content of the given packets."""
        begin, end = (packets.at - HEADER).tolist(), (packets.at + packets.size).tolist()
        for at, content in zip(begin, self._contents.ranges(list(zip(begin, end, strict=True))), strict=True):
            yield at, content.data[HEADER:]

    def decode(self) -> Columns:
        columns: list[Columns] = []
        for part in self._parts():
            # converted now, while its bytes are in the processor's cache
            valid = self._valid(part)
            if valid is None:
                return self._columns(list(self._parts()))
            columns.append(valid)
        return concatenate(columns) if columns else Columns.empty(0)

    def _parts(self) -> Iterator[np.ndarray]:
        """Yield the events of each packet. FormatError, even if not `strict`, if no packet can be read."""
        return self._readable(self._packets("EVTS"), _events_of, "packets", some=True)

    def _readable(
        self, packets: Iterator[tuple[int, memoryview]], read: Callable[[memoryview], Packed], name: str, *, some: bool
    ) -> Iterator[Packed]:
        """Yield the result of `read` for each packet.

        If not `strict`, damaged packets are left out, and so are all packets after a damaged size. But if `some` is
        true and no packet can be read, the first error is raised.
        """
        count, damaged, first, left = 0, 0, None, self._allowance
        try:
            for at, packet in packets:
                try:
                    found = self._content(at, packet, read, left)
                except FormatError as error:
                    if self.strict:
                        raise
                    first, damaged = first or error, damaged + 1
                    self._repair(f"damaged {name}, left out", damaged)
                else:
                    yield found
                    count += 1
        except FormatError as error:
            if self.strict:
                raise
            first = first or error
            self._repair(f"{name} from the first damaged one on, cut off", 1)
        if some and first is not None and not count:
            raise first

    def _valid(self, events: np.ndarray) -> Columns | None:
        """Return the columns of a packet's events; None if any of them is invalid."""
        columns = Columns.empty(events.size)
        words = np.frombuffer(events.tobytes(), np.int64)
        return columns if aedat4_decode(words, LATEST, *self._limits, *columns) else None

    def _columns(self, parts: list[np.ndarray], first: int = 0) -> Columns:
        """Return the columns of packets' events; the first event has the number `first` in the file."""
        valid = [columns for part in parts if (columns := self._valid(part)) is not None]
        if len(valid) == len(parts):
            return concatenate(valid) if valid else Columns.empty(0)
        events = self._timed(np.concatenate(parts), first)
        kept = self._inside([events[name] for name in EVENTS], first)
        return Columns(*(np.ascontiguousarray(column) for column in kept))

    def decode_window(self, start: int, stop: int) -> Columns | None:
        packets = self._table("EVTS")
        if packets is None or not packets.ordered:
            return None
        lo, hi = int(packets.end.searchsorted(start)), int(packets.start.searchsorted(stop))
        # one more packet on each side, to check that the window doesn't overlap them
        lo, hi = max(lo - 1, 0), min(max(lo, hi) + 1, packets.at.size)
        touched = packets.take(slice(lo, hi))
        left = self._allowance
        parts = [self._content(at, packet, _events_of, left) for at, packet in self._chosen(touched)]
        columns = self._columns(parts, int(packets.elements[:lo].sum()))
        whole = not self._cached or self._leaves_none_out(touched, lo == 0, hi == packets.at.size)
        if not (is_sorted(columns.t) and self._agree(touched, parts) and whole):
            self._listed["EVTS"] = None
            return None
        a, b = columns.t.searchsorted(start), columns.t.searchsorted(stop)
        return columns.take(slice(a, b))

    def decode_span(self) -> tuple[int, int] | None:
        packets = self._table("EVTS")
        if packets is None or not packets.ordered:
            return None
        if not packets.at.size:
            return 0, 0
        if not self._ends_checked:
            ends = packets.take(np.array([0, -1]))
            left = self._allowance
            parts = [self._content(at, packet, _events_of, left) for at, packet in self._chosen(ends)]
            if not self._agree(ends, parts):
                return None
            self._ends_checked = True
        return int(packets.start[0]), int(packets.end[-1])

    def _leaves_none_out(self, packets: Packets, first: bool, last: bool) -> bool:
        """Return whether a cached index lists all packets of events between the given ones.

        If `first` is true, the file may have no packets of events before the given ones; if `last`, none after them.
        """
        begins, ends = (packets.at - HEADER).tolist(), (packets.at + packets.size).tolist()
        begins, ends = begins[not first :] + [self._end] * last, [self._first] * first + ends[: len(ends) - (not last)]
        left = self._allowance
        for at, stop in zip(ends, begins, strict=True):
            while at < stop:
                stream, size = self._contents.read(at, at + HEADER).view("<i4").tolist()
                if size < 0:
                    return False
                if stream == self._streams["EVTS"][0]:
                    packet = self._contents.read(at + HEADER, at + HEADER + size).data
                    # packets without events aren't in the index
                    if self._content(at, packet, _events_of, left).size:
                        return False
                at += HEADER + size
        return True

    def _agree(self, packets: Packets, parts: list[np.ndarray]) -> bool:
        """Return whether the events `parts` of packets have the numbers, first times and last times of `packets`."""
        if [part.size for part in parts] != packets.elements.tolist():
            return False
        ends = [(part["t"][0], part["t"][-1]) for part in parts]
        return ends == list(zip(packets.start.tolist(), packets.end.tolist(), strict=True))

    def _timed(self, events: np.ndarray, first: int) -> np.ndarray:
        """Return the events whose times `Events` supports; the first event has the number `first` in the file.

        If `strict`, FormatError for any other time.
        """
        late = (events["t"] <= -LATEST) | (events["t"] >= LATEST)
        if self.strict and late.any():
            raise FormatError(self.path, f"event {first + int(np.argmax(late))}: a time at or beyond 2^62 µs")
        self._repair("events at or beyond 2^62 µs, dropped", int(np.count_nonzero(late)))
        return events[~late]

    @property
    def _allowance(self) -> Allowance:
        """A new limit for packets that are decompressed together."""
        return Allowance(self._contents.size)

    def _content(self, at: int, packet: memoryview, read: Callable[[memoryview], Packed], left: Allowance) -> Packed:
        """Return the result of `read` for a packet. FormatError if it is damaged or expands to too many bytes.

        `left` is the number of bytes that may still be decompressed.
        """
        most = left.of(len(packet))
        try:
            inflated = self._inflate(packet, most)
            left.take(len(inflated))
            return read(memoryview(inflated))
        except OverflowError as error:
            # so that the next such packet fails at once
            left.take(most)
            raise FormatError(self.path, f"{error}, too far: {left.reason}", offset=at) from error
        except Exception as error:  # lz4 and zstandard raise their own errors
            raise self._fault(at, error) from error

    def _samples(
        self, kind: str, read: Callable[[memoryview], Packed], start: int | None, stop: int | None
    ) -> Iterator[Packed]:
        """Yield the result of `read` for each packet of a stream, except for packets that a table shows as outside."""
        check_window(start, stop)
        if kind not in self._streams:
            return
        table = self._table(kind)
        if table is None:
            packets = self._packets(kind)
        else:
            least, most = -LATEST if start is None else start - LONG, LATEST if stop is None else stop + LONG
            packets = self._chosen(table.take((table.end >= least) & (table.start < most)))
        yield from self._readable(packets, read, f"packets of {kind}", some=False)

    def frames(self, start: int | None = None, stop: int | None = None) -> Iterator[Frame]:
        return within(self._samples("FRME", unpack_frame, start, stop), start, stop)

    def inertial(self, start: int | None = None, stop: int | None = None) -> Inertial:
        return Inertial.joined(list(self._samples("IMUS", unpack_inertial, start, stop))).window(start, stop)

    def triggers(self, start: int | None = None, stop: int | None = None) -> Triggers:
        return Triggers.joined(list(self._samples("TRIG", unpack_triggers, start, stop))).window(start, stop)


def _events_of(payload: memoryview) -> np.ndarray:
    """Return the events of a packet, a structured array [N] of the type EVENT."""
    first, count = Table.root(payload, 4, b"EVTS").vector(0)
    if count * EVENT.itemsize > len(payload) - first:
        raise ValueError(f"{count} events in {len(payload)} bytes")
    return np.frombuffer(payload, EVENT, count, first)


def _streams(root: Any) -> dict[str, tuple[int, dict[str, str]]]:
    """Return number and attributes of the first stream of each type. ValueError if no stream has events."""
    found: dict[str, tuple[int, dict[str, str]]] = {}
    for node in root.iter("node"):
        attributes = {attr.get("key"): attr.text or "" for attr in node.findall("attr")}
        if "typeIdentifier" in attributes:
            about = {attr.get("key"): attr.text or "" for info in node.findall("node") for attr in info.findall("attr")}
            found.setdefault(attributes["typeIdentifier"], (int(node.get("name", "")), about))
    if "EVTS" not in found:
        raise ValueError("no stream of events")
    return found


FORMAT = Format(
    "aedat4",
    (".aedat4", ".aedat"),
    Aedat4Recording,
    begins=starts_with(MAGIC[:11]),
    write=write,
    holds_samples=True,
    packages=("lz4", "zstandard"),
)
