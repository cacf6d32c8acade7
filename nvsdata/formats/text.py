"""Text, an event a line: `x y t p` with t in µs, or `t x y p` with t in seconds.

The second form is told by a decimal point in the first number, or by a first line of two numbers,
the width and the height. Our own files begin with a comment that states the sensor and that the
events are sorted, so that a window is found by bisection over the bytes.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from nvsdata.errors import FormatError
from nvsdata.events import Columns, Events
from nvsdata.events import Recording as BaseRecording
from nvsdata.formats.records import bytes_of
from nvsdata.kernels import text as kernel
from nvsdata.kernels.order import never_falls

FAULTS = {
    kernel.BAD_NUMBER: "not a number",
    kernel.BAD_COUNT: "a line must hold four numbers",
    kernel.OUT_OF_RANGE: "coordinates must lie between 0 and 32766 and polarity between -1 and 1",
}
OWN = re.compile(rb"# nvsdata events: x y t p, sorted, sensor (\d+)x(\d+)\n")
SIZE = re.compile(rb"[ \t]*(\d+)[ \t]+(\d+)[ \t]*\r?\n")
SECONDS = re.compile(rb"[ \t]*-?\d+\.\d")
CHUNK = 1 << 14  # bytes that are parsed rather than bisected further


class Recording(BaseRecording):
    """A text file of events."""

    format = "text"

    def __init__(self, path: str, sensor_size: tuple[int, int] | None, head: bytes, strict: bool) -> None:
        super().__init__(path, sensor_size, strict)
        self._raw = np.frombuffer(bytes_of(path, head), np.uint8)
        self._body = 0
        own = OWN.match(head)
        size = own or SIZE.match(head)
        self._sorted = own is not None
        if size:
            self._body = size.end()
            self._size = self._size or (int(size[1]), int(size[2]))
        self._seconds = not own and (size is not None or SECONDS.match(_first_line(head)) is not None)

    def _decode(self) -> Columns:
        return self._parse(self._body, self._raw.size)

    def _parse(self, start: int, stop: int) -> Columns:
        lines = int(np.count_nonzero(self._raw[start:stop] == kernel.NEWLINE)) + 1
        columns = np.empty((4, lines), np.int64)
        kept, fault, where, dropped = kernel.text_decode(
            self._raw, start, stop, self._seconds, not self.strict, columns
        )
        self._repair("lines that are no event, dropped", int(dropped))
        if fault:
            raise FormatError(self.path, int(where), FAULTS[fault])
        t, x, y, p = columns[:, :kept]
        if self._size is not None:
            t, x, y, p = self._inside((t, x, y, p))
        return Columns(t, x.astype(np.int16), y.astype(np.int16), p.astype(np.uint8))

    def _window(self, start: int, stop: int) -> Columns | None:
        if not self._sorted:
            return None
        lo, hi = self._line_before(start), self._line_before(stop)
        hi = self._next_line(min(hi + 2 * CHUNK, self._raw.size))
        columns = self._parse(lo, hi)
        if not never_falls(columns.t):
            return None
        a, b = columns.t.searchsorted(start, "left"), columns.t.searchsorted(stop, "left")
        return columns.at(slice(a, b))

    def _line_before(self, time: int) -> int:
        """Byte of a line at most CHUNK bytes before the first event at or after `time`."""
        lo, hi = self._body, self._raw.size
        while hi - lo > CHUNK:
            middle = self._next_line((lo + hi) // 2)
            end = self._next_line(middle + 1)
            if middle >= hi or end <= middle:
                break
            t = self._parse(middle, end).t
            if t.size and t[0] < time:
                lo = middle
            else:
                hi = (lo + hi) // 2
        return lo

    def _next_line(self, at: int) -> int:
        """First byte at or after `at` that begins a line, or the end of the file."""
        while at < self._raw.size and at > self._body and self._raw[at - 1] != kernel.NEWLINE:
            at += 1
        return min(at, self._raw.size)


def _first_line(head: bytes) -> bytes:
    """The first line that is neither empty nor a comment."""
    for line in head.splitlines():
        if line.strip() and not line.startswith(b"#"):
            return line
    return b""


def looks_like(head: bytes, size: int) -> bool:
    """Whether it begins with a line of two or four decimal numbers, after comments."""
    line = _first_line(head)
    return re.fullmatch(rb"\s*-?[\d.]+([ \t,]+-?[\d.]+)([ \t,]+-?[\d.]+[ \t,]+-?[\d.]+)?\s*", line) is not None


def write(pieces: Iterable[Events], sensor_size: tuple[int, int], path: Path) -> None:
    """Write lines `x y t p` under a comment that states sensor and order."""
    width, height = sensor_size
    with path.open("w", encoding="ascii", newline="\n") as file:
        file.write(f"# nvsdata events: x y t p, sorted, sensor {width}x{height}\n")
        for events in pieces:
            table = np.column_stack((events.x, events.y, events.t, events.p))
            for start in range(0, len(table), 1 << 16):
                rows = table[start : start + (1 << 16)].tolist()
                file.write("".join(f"{x} {y} {t} {p}\n" for x, y, t, p in rows))
