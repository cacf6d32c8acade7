"""Text, one event per line of four numbers.

A line of names states what the numbers are: `timestamp,x,y,polarity`, with `_us` or `_s` for the unit of time, which is
s if any of the first times has decimals, otherwise µs. It may be a comment. A first line of two numbers is width and
height, and `t x y p` with t in s follow; so they do if the first number has a decimal point.

For other lines of numbers, the order is guessed from the first ones: `x y t p` if these can be read so, unless its
times fall or hardly differ and those of another order don't; otherwise `t x y p` or `x y p t` (Metavision). Comments
begin with `#` or `%`.

nvsdata's own files begin with a comment that states the sensor, and that the events are sorted. In such a file, a
window is found by bisection over the bytes.
"""

from __future__ import annotations

import re
from itertools import pairwise
from pathlib import Path

import numpy as np

from nvsdata.common.errors import FormatError
from nvsdata.data.events import Columns, concatenate
from nvsdata.formats.contents import Contents
from nvsdata.formats.file_recording import FileRecording
from nvsdata.formats.records import stated_size
from nvsdata.formats.registry import Format
from nvsdata.formats.text_layout import TextLayout, layout_of, looks_like
from nvsdata.formats.writing import Pieces, file_with_header, stated_time, time_comment
from nvsdata.kernels.decode import text as kernel
from nvsdata.kernels.decode.order import is_sorted

FAULTS = {
    kernel.BAD_NUMBER: "not a number",
    kernel.BAD_COUNT: "a line must have four numbers",
    kernel.OUT_OF_RANGE: "coordinates must be between 0 and 32766 and polarity between -1 and 1",
    kernel.TOO_LATE: "a time at or beyond 2^62 µs",
}
OWN = re.compile(rb"# nvsdata events: x y t p, sorted, sensor (\d+)x(\d+)\n([^\n]* us\n)?")
EVENT = re.compile(rb"\d+ \d+ (-?\d{1,19}) \d\r?\n?")  # a line of nvsdata's own files
CHUNK = 1 << 14  # bytes; bisection ends at this size, and the rest is parsed
LINE = 128  # bytes that are read to find a line
PIECE = 1 << 24  # bytes that are parsed at a time


class TextRecording(FileRecording):
    """A text file of events."""

    format = "text"

    def __init__(self, path: str, sensor_size: tuple[int, int] | None, head: bytes, strict: bool) -> None:
        super().__init__(path, sensor_size, strict)
        self._contents = Contents(path, head)
        self._probed: dict[int, tuple[int, int | None]] = {}
        own = OWN.match(head)
        self._sorted = own is not None
        try:
            self._layout = TextLayout("xytp", False, own.end(), (own[1], own[2]), True) if own else layout_of(head)
        except ValueError as error:
            raise FormatError(path, str(error)) from None
        self._body = self._layout.body
        if self._layout.size:
            self._size = self._size or stated_size(path, *(side.decode() for side in self._layout.size))
        if own and own[3]:
            self._state_times(stated_time([own[3].decode("latin-1")]))

    def decode(self) -> Columns:
        columns = self._parse(self._body, self._contents.size)
        self._rises = is_sorted(columns.t)
        if self._sorted and self.strict and not self._rises:
            late = int(np.argmax(columns.t[1:] < columns.t[:-1])) + 1
            raise FormatError(self.path, f"event {late} is earlier than the one before it")
        return columns

    def _parse(self, start: int, stop: int) -> Columns:
        """Decode the lines between two offsets."""
        cuts = [start]
        while cuts[-1] < stop:
            cuts.append(min(self._line_from(cuts[-1] + PIECE)[0], stop))
        parsed = [self._lines(lo, hi) for lo, hi in pairwise(cuts)] or [(Columns.empty(0), 0)]
        self._repair("lines that aren't events, dropped", sum(dropped for _, dropped in parsed))
        columns = concatenate([columns for columns, _ in parsed])
        return Columns(*self._inside(columns)) if self._size is not None else columns

    def _lines(self, start: int, stop: int) -> tuple[Columns, int]:
        """Decode a piece of the file; return events and the number of lines that were dropped."""
        raw = self._contents.read(start, stop)
        columns = Columns.empty(int(np.count_nonzero(raw == ord("\n"))) + 1)
        kept, fault, where, dropped = kernel.text_decode(
            raw, self._layout.order, self._layout.seconds, not self.strict, *columns
        )
        if fault:
            reason = FAULTS[fault]
            if not self._layout.stated:
                order = " ".join(self._layout.order)
                reason += f" (lines are taken as {order}; a first line such as t,x,y,p names them)"
            raise FormatError(self.path, reason, offset=start + where)
        return columns.first(kept), dropped

    def decode_window(self, start: int, stop: int) -> Columns | None:
        """Decode a window found by bisection over the lines; return None if events of it may be missing."""
        if not (self._sorted and self.strict):
            return None
        size = self._contents.size
        lo, (_, hi) = self._around(start)[0], self._around(stop)
        hi = self._line_from(max(lo, hi) + CHUNK)[0]
        columns = self._parse(lo, hi)
        t = columns.t
        first, last = t.searchsorted((start, stop)).tolist()
        if not is_sorted(t) or (first == 0 and lo > self._body) or (last == t.size and hi < size):
            return None
        return columns.take(slice(first, last))

    def _around(self, time: int) -> tuple[int, int]:
        """Return a range of bytes in which the first event at or after `time` begins. The range begins with a line."""
        lo, hi = self._body, self._contents.size
        while hi - lo > CHUNK:
            middle = (lo + hi) // 2
            begin, t = self._probe(middle)
            if begin >= hi or t is None:
                break
            if t < time:
                lo = begin
            else:
                hi = middle
        return lo, hi

    def _probe(self, at: int) -> tuple[int, int | None]:
        """Return offset and time (µs; None if it isn't an event) of the first line at or after `at`, and cache them."""
        if at not in self._probed:
            begin, line = self._line_from(at)
            event = EVENT.fullmatch(line)
            self._probed[at] = begin, int(event[1]) if event else None
        return self._probed[at]

    def _line_from(self, at: int) -> tuple[int, bytes]:
        """Return the offset of the first line at or after `at`, and that line; the file's size if there is none."""
        size, length = self._contents.size, LINE
        while at < size:
            stop = min(at + length, size)
            # from the byte before, because a line begins after a line end
            piece = self._contents.read(at - 1, stop).tobytes()
            begin = piece.find(b"\n") + 1
            end = piece.find(b"\n", begin) + 1 if begin else 0
            if end or stop == size:
                return (at - 1 + begin, piece[begin : end or None]) if begin else (size, b"")
            length *= 16
        return size, b""


def write(pieces: Pieces, path: Path) -> None:
    """Write lines `x y t p` after comments that state sensor size, order and time range."""
    with file_with_header(path, pieces, _header) as file:
        for events in pieces:
            table = np.column_stack((events.x, events.y, events.t, events.p))
            for start in range(0, len(table), 1 << 16):
                rows = table[start : start + (1 << 16)].tolist()
                file.write("".join(f"{x} {y} {t} {p}\n" for x, y, t, p in rows).encode("ascii"))


def _header(pieces: Pieces) -> bytes:
    width, height = pieces.sensor_size
    lines = (f"# nvsdata events: x y t p, sorted, sensor {width}x{height}", time_comment(pieces))
    return "".join(f"{line}\n" for line in lines).encode("ascii")


FORMAT = Format("text", (".txt", ".csv", ".text"), TextRecording, looks_like=looks_like, write=write)
