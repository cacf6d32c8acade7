"""AEDAT 3.0 and 3.1 (cAER, libcaer): DVS128 Gesture.

Header lines begin with `#` and end with CR LF; the last is `#!END-HEADER`. Little-endian packets follow: a header of 28
bytes, then events of one type and size. A window decodes only the polarity packets that overlap it; packets of other
types are skipped.
"""

from __future__ import annotations

import os
import re
import warnings
from collections.abc import Iterator
from functools import cached_property, partial
from itertools import pairwise
from pathlib import Path

import numpy as np

from nvsdata.common.errors import FormatError, shown
from nvsdata.data.events import EVER, LATEST, Columns, Events, sort_by_time
from nvsdata.formats.contents import PIECE, Contents
from nvsdata.formats.file_recording import FileRecording
from nvsdata.formats.records import stated_size
from nvsdata.formats.registry import Format, starts_with
from nvsdata.formats.writing import Pieces, file_with_header, stated_time, time_comment
from nvsdata.kernels.decode.aedat3 import (
    ADDED,
    CUT,
    DISORDER_US,
    FIRST,
    FIRST_BYTE,
    LAST,
    NONSENSE,
    NUMBER,
    PACKET_HEADER,
    POLARITY_EVENT,
    SOME_INVALID,
    TORN,
    aedat3_decode,
    aedat3_packets,
)
from nvsdata.kernels.decode.clock import kept_words

CAN_SEEK = hasattr(os, "pread")  # without it, the packet index is computed from the entire file in memory
FAULTS = {TORN: "truncated within a packet", NONSENSE: "no packet begins here", CUT: "truncated while it was read"}
SENSORS = {"DVS128": (128, 128), "DAVIS240": (240, 180), "DAVIS346": (346, 260), "DVXPLORER": (640, 480)}
PACKET = 8192  # events per packet in written files


class Aedat3Recording(FileRecording):
    """An AEDAT 3 file."""

    format = "aedat3"

    def __init__(self, path: str, sensor_size: tuple[int, int] | None, head: bytes, strict: bool) -> None:
        super().__init__(path, sensor_size, strict)
        self._contents = Contents(path, head)
        lines, end = self._contents.header(b"#")
        if not lines or (lines[0] == "#!AER-DAT3.1" and lines[-1].lower() != "#!end-header"):
            raise FormatError(path, "truncated or damaged: the header has no line #!END-HEADER", offset=end)
        source = next((m[1].upper() for line in lines if (m := re.match(r"#Source \d+: (\S+)", line))), "")
        self._size = self._size or self._size_of(source)
        # the origin of 3.0 is at the bottom left
        self._upside_down = lines[0].startswith("#!AER-DAT3.0")
        if self._upside_down and self._size is None:
            raise FormatError(
                path, "AEDAT 3.0 of an unknown camera counts y from the bottom: pass sensor_size", offset=0
            )
        self._start = end
        self._state_times(stated_time(lines))
        self._found: np.ndarray | None = None
        self._contents.drop_head()

    def _size_of(self, source: str) -> tuple[int, int] | None:
        stated = re.fullmatch(r"NVSDATA-(\d+)X(\d+)", source)
        if stated:
            return stated_size(self.path, stated[1], stated[2])
        return next((size for name, size in SENSORS.items() if source.startswith(name)), None)

    @property
    def packets(self) -> np.ndarray:
        """The index of polarity packets, as `aedat3_packets` returns it; computed at its first use."""
        if self._found is None:
            contents = self._contents
            known = np.frombuffer(contents.head, np.uint8) if CAN_SEEK else contents.read(0, contents.size)
            with contents.handle() as handle:
                found, fault, at = aedat3_packets(known, handle, contents.size, self._start)
            if fault == CUT or (fault and self.strict):
                raise FormatError(self.path, FAULTS[fault], offset=int(at))
            self._repair("bytes of torn or damaged packets, cut off", contents.size - int(at))
            self._found = found
        return self._found

    @cached_property
    def _reach(self) -> tuple[np.ndarray, ...]:
        """The earliest and the latest time in µs, int64 [M] each, that an event of each packet may have."""
        packets = self.packets
        reach = np.stack((packets[:, FIRST] - DISORDER_US, packets[:, LAST] + DISORDER_US))
        # the times of a packet may be those of invalid events
        reach[:, packets[:, SOME_INVALID] > 0] = np.array(EVER)[:, None]
        return tuple(reach)

    def _of_packets(self, packets: np.ndarray) -> Columns:
        width, height = self._limits
        columns = Columns.empty(int(packets[:, NUMBER].sum()))
        kept = unmarked = dropped = 0
        for some, raw, base in self._read(packets):
            count, bad, without, strayed = aedat3_decode(raw, base, some, width, height, kept, *columns)
            if self.strict and bad >= 0:
                raise FormatError(self.path, f"coordinates outside the sensor of {width}x{height}", offset=int(bad))
            if strayed >= 0:
                at = int(some[strayed, FIRST_BYTE]) - PACKET_HEADER
                if self.strict:
                    raise FormatError(
                        self.path, "a packet with events before its first, after its last, or before time 0", offset=at
                    )
                count, lost = self._salvaged(raw, base, some, kept, columns)
                dropped += lost
            kept += count
            unmarked += without
        self._repair("events of times that fit no packet, dropped", dropped)
        if unmarked:
            what = "events are not marked valid, though their packets count them as valid; they are kept"
            warnings.warn(f"{shown(self.path)}: {unmarked} {what}", stacklevel=2)
        columns = columns.first(kept)
        if self._upside_down:
            columns = columns._replace(y=(height - 1 - columns.y).astype(np.int16))
        return columns

    def _read(self, packets: np.ndarray) -> Iterator[tuple[np.ndarray, np.ndarray, int]]:
        """Yield packets in groups: their rows of the index, their bytes, and the offset of these bytes in the file."""
        begins, ends = packets[:, FIRST_BYTE], packets[:, FIRST_BYTE] + 8 * packets[:, NUMBER]
        # a group's packets begin in the same half piece, so that a group, whose last packet extends beyond it, rarely
        # exceeds a piece
        half = PIECE // 2
        edges = [0, *(np.flatnonzero(np.diff(begins // half)) + 1).tolist(), len(packets)]
        parts = [(lo, hi) for lo, hi in pairwise(edges) if lo < hi]
        pieces = self._contents.ranges([(int(begins[lo]), int(ends[hi - 1])) for lo, hi in parts])
        for (lo, hi), raw in zip(parts, pieces, strict=True):
            yield packets[lo:hi], raw, int(begins[lo])

    def _salvaged(
        self, raw: np.ndarray, base: int, packets: np.ndarray, kept: int, columns: Columns
    ) -> tuple[int, int]:
        """Decode damaged packets; drop events whose times don't fit. Return the numbers of kept and dropped events."""
        begin, lost = kept, 0
        width, height = self._limits
        for k in range(len(packets)):
            count, _, _, strayed = aedat3_decode(raw, base, packets[k : k + 1], width, height, kept, *columns)
            if strayed >= 0:
                some = columns.take(slice(kept, kept + count))
                # the file has signed times of 31 bits
                since = (some.t - packets[k, ADDED]).astype(np.uint32).view(np.int32).astype(np.int64)
                fits = kept_words(since, 40, DISORDER_US) & (since >= 0)
                left = int(np.count_nonzero(fits))
                lost, count = lost + count - left, left
                for column, fitting in zip(columns, some.take(fits), strict=True):
                    column[kept : kept + count] = fitting
            kept += count
        return kept - begin, lost

    def decode(self) -> Columns:
        return self._of_packets(self.packets)

    def decode_window(self, start: int, stop: int) -> Columns | None:
        """Decode the packets that overlap the window, whatever their order in the file."""
        if not self.strict:
            return None
        first, last = self._reach
        columns = sort_by_time(self._of_packets(self.packets[(last >= start) & (first < stop)]))
        a, b = columns.t.searchsorted(start, "left"), columns.t.searchsorted(stop, "left")
        return columns.take(slice(a, b))

    def decode_span(self) -> tuple[int, int] | None:
        if not self.strict or self.packets[:, SOME_INVALID].any():
            return None
        if not len(self.packets):
            return 0, 0
        first, last = int(self.packets[:, FIRST].min()), int(self.packets[:, LAST].max())
        head, tail = self.decode_window(EVER[0], first + 1), self.decode_window(last, EVER[1])
        if head is None or tail is None or not (head.t.size and tail.t.size):
            return None
        return int(head.t[0]), int(tail.t[-1])


def write(pieces: Pieces, path: Path) -> None:
    """Write AEDAT 3.1 polarity packets. ValueError for times outside [0, 2^62) µs.

    The header's source is the known camera with this sensor size or, if there is none, `nvsdata-WxH`.
    """
    width, height = pieces.sensor_size
    name = next((name for name, size in SENSORS.items() if size == (width, height)), f"nvsdata-{width}x{height}")
    with file_with_header(path, pieces, partial(_header, name)) as file:
        for events in pieces:
            for packet in _packets(events):
                file.write(packet)


def _header(source: str, pieces: Pieces) -> bytes:
    lines = ("#!AER-DAT3.1", "#Format: RAW", f"#Source 1: {source}", time_comment(pieces), "#!END-HEADER")
    return "".join(f"{line}\r\n" for line in lines).encode()


def _packets(events: Events) -> Iterator[bytes]:
    t = events.t
    if t[0] < 0 or t[-1] >= LATEST:
        raise ValueError("AEDAT 3.1 supports times from 0 to 2^62 - 1 µs only")
    records = np.empty((t.size, 2), "<u4")
    records[:, 0] = events.x.astype(np.uint32) << 17 | events.y.astype(np.uint32) << 2
    records[:, 0] |= events.p.astype(np.uint32) << 1 | 1
    records[:, 1] = t & 0x7FFFFFFF
    # a packet has a single overflow count, so it ends where the count changes
    ends = np.unique(
        np.concatenate((np.flatnonzero(np.diff(t >> 31)) + 1, np.arange(PACKET, t.size, PACKET), [t.size]))
    )
    for lo, hi in zip(np.concatenate(([0], ends[:-1])), ends, strict=True):
        n = hi - lo
        yield np.array([POLARITY_EVENT, 1], "<u2").tobytes()
        yield np.array([8, 4, t[lo] >> 31, n, n, n], "<u4").tobytes()
        yield records[lo:hi].tobytes()


FORMAT = Format("aedat3", (".aedat3", ".aedat"), Aedat3Recording, begins=starts_with(b"#!AER-DAT3."), write=write)
