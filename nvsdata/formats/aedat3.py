"""AEDAT 3.0 and 3.1 (cAER, libcaer): DVS128 Gesture.

Header lines begin with `#` and end CR LF, the last is `#!END-HEADER`. Packets follow, little-endian:
28 bytes of header, then events of one type and size. Of polarity packets a window decodes only
those that it touches; packets of other types are passed over by their size.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np

from nvsdata.errors import FormatError
from nvsdata.events import Columns, Events, in_order
from nvsdata.events import Recording as BaseRecording
from nvsdata.formats.records import bytes_of, header_lines
from nvsdata.kernels.aedat import NONSENSE, POLARITY_EVENT, TORN, aedat3_decode, aedat3_packets

SENSORS = {"DVS128": (128, 128), "DAVIS240": (240, 180), "DAVIS346": (346, 260), "DVXPLORER": (640, 480)}
PACKET = 8192  # events of a packet that is written


class Recording(BaseRecording):
    """An AEDAT 3 file."""

    format = "aedat3"

    def __init__(self, path: str, sensor_size: tuple[int, int] | None, head: bytes, strict: bool) -> None:
        super().__init__(path, sensor_size, strict)
        memory = bytes_of(path, head)
        lines, end = header_lines(memory, b"#")
        if not lines or (lines[0] == "#!AER-DAT3.1" and lines[-1].lower() != "#!end-header"):
            raise FormatError(path, end, "truncated or damaged: the header has no line #!END-HEADER")
        source = next((m[1].upper() for line in lines if (m := re.match(r"#Source \d+: (\S+)", line))), "")
        self._size = self._size or _size_of(source)
        # 3.0 had its origin at the bottom left
        self._upside_down = lines[0].startswith("#!AER-DAT3.0")
        if self._upside_down and self._size is None:
            raise FormatError(path, 0, "AEDAT 3.0 of an unknown camera counts y from the bottom: pass sensor_size")
        self._raw = np.frombuffer(memory, np.uint8)
        self._start = end
        self._found: np.ndarray | None = None

    @property
    def packets(self) -> np.ndarray:
        """The index of polarity packets, as `aedat3_packets` gives it; made at its first use."""
        if self._found is None:
            self._found, fault, at = aedat3_packets(self._raw, self._start)
            if fault and self.strict:
                reason = {TORN: "truncated within a packet", NONSENSE: "no packet begins here"}[fault]
                raise FormatError(self.path, int(at), reason)
            self._repair("bytes of torn or damaged packets, cut off", int(self._raw.size - at))
        return self._found

    def _of_packets(self, packets: np.ndarray) -> Columns:
        width, height = self._size or (0, 0)
        words, phase, starts = self._words(packets)
        room = Columns.room(int(packets[:, 1].sum()))
        count, bad, unmarked = aedat3_decode(words, phase, starts, packets, width, height, *room)
        columns = room.first(count)
        if bad >= 0 and self.strict:
            raise FormatError(self.path, int(bad), f"coordinates outside the sensor of {width}x{height}")
        if unmarked:
            warnings.warn(
                f"{self.path}: {unmarked} events are not marked valid, though their packets count them as valid; kept",
                stacklevel=2,
            )
        if self._upside_down:
            columns = columns._replace(y=(height - 1 - columns.y).astype(np.int16))
        return columns

    def _words(self, packets: np.ndarray) -> tuple[np.ndarray, int, np.ndarray]:
        """32-bit words that hold `packets`, the byte that they begin at, and where in them each packet begins."""
        starts = packets[:, 0]
        phase = int(starts[0]) % 4 if len(starts) else 0
        if (starts % 4 == phase).all():
            return np.ndarray((self._raw.size - phase) // 4, "<u4", self._raw, phase), phase, starts
        # frames between them may be of odd sizes
        pieces = [self._raw[start : start + 8 * number] for start, number in packets[:, :2].tolist()]
        return np.concatenate(pieces).view("<u4"), 0, np.cumsum(8 * packets[:, 1]) - 8 * packets[:, 1]

    def _decode(self) -> Columns:
        return self._of_packets(self.packets)

    def _window(self, start: int, stop: int) -> Columns | None:
        """Decode the packets that reach into the window, in whatever order they lie in the file."""
        first, last = self.packets[:, 3], self.packets[:, 4]
        columns = in_order(self._of_packets(self.packets[(last >= start) & (first < stop)]))
        a, b = columns.t.searchsorted(start, "left"), columns.t.searchsorted(stop, "left")
        return columns.at(slice(a, b))

    def _bounds(self) -> tuple[int, int] | None:
        if not len(self.packets):
            return 0, 0
        # times rise within a packet, but the first or last event may be an invalid one
        if self.packets[:, 5].any():
            return None
        return int(self.packets[:, 3].min()), int(self.packets[:, 4].max())


def _size_of(source: str) -> tuple[int, int] | None:
    stated = re.fullmatch(r"NVSDATA-(\d+)X(\d+)", source)
    if stated:
        return int(stated[1]), int(stated[2])
    return next((size for name, size in SENSORS.items() if source.startswith(name)), None)


def write(pieces: Iterable[Events], sensor_size: tuple[int, int], path: Path) -> None:
    """Write AEDAT 3.1 polarity packets. ValueError for times outside [0, 2^62) µs.

    The source is named after the sensor where one of its size is known, else `nvsdata-WxH`.
    """
    width, height = sensor_size
    name = next((name for name, size in SENSORS.items() if size == (width, height)), f"nvsdata-{width}x{height}")
    lines = ("#!AER-DAT3.1", "#Format: RAW", f"#Source 1: {name}", "#!END-HEADER")
    with path.open("wb") as file:
        file.write("".join(f"{line}\r\n" for line in lines).encode())
        for events in pieces:
            for packet in _packets(events):
                file.write(packet)


def _packets(events: Events) -> Iterator[bytes]:
    t = events.t
    if t[0] < 0 or t[-1] >= 1 << 62:
        raise ValueError("AEDAT 3.1 holds times from 0 to 2^62 - 1 µs only")
    records = np.empty((t.size, 2), "<u4")
    records[:, 0] = events.x.astype(np.uint32) << 17 | events.y.astype(np.uint32) << 2
    records[:, 0] |= events.p.astype(np.uint32) << 1 | 1
    records[:, 1] = t & 0x7FFFFFFF
    # a packet has one overflow count
    ends = np.unique(
        np.concatenate((np.flatnonzero(np.diff(t >> 31)) + 1, np.arange(PACKET, t.size, PACKET), [t.size]))
    )
    for lo, hi in zip(np.concatenate(([0], ends[:-1])), ends, strict=True):
        n = hi - lo
        yield np.array([POLARITY_EVENT, 1], "<u2").tobytes()
        yield np.array([8, 4, t[lo] >> 31, n, n, n], "<u4").tobytes()
        yield records[lo:hi].tobytes()
