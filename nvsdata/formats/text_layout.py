"""The order and units of the numbers in lines of text, by a line of names or by the first lines of numbers."""

from __future__ import annotations

import re
from io import BytesIO
from typing import NamedTuple

import numpy as np

from nvsdata.data.events import Columns
from nvsdata.formats.contents import HEAD
from nvsdata.kernels.decode.text import text_decode

MARK = b"\xef\xbb\xbf"  # byte order mark, with which some programs begin a file
COMMENTS = b"#", b"%"
BETWEEN = b" \t,;\r\n"  # what is between numbers
SEPARATORS = re.compile(rb"[ \t,;]+")
SIZE = re.compile(rb"(\d+)[ \t]+(\d+)")
GEOMETRY = re.compile(rb"%[ \t]*geometry:[ \t]*(\d+)[,x](\d+)")  # as Metavision writes it
NUMBER = re.compile(rb"-?[\d.]+")
SECONDS = re.compile(rb"-?\d+\.\d")
NAMES = {
    "x": "x",
    "y": "y",
    **dict.fromkeys(("t", "ts", "time", "times", "timestamp", "timestamps", "event_timestamp"), "t"),
    **dict.fromkeys(("p", "pol", "polarity", "polarities"), "p"),
}
LONGEST = 24  # characters of a name
UNIT = re.compile(r"([a-z_]+?)_?[\[(]?(us|µs|μs|s)[\])]?")
EXAMINED = 1 << 14  # bytes of the first lines
MAJORITY = 0.9  # share of lines that must agree: some may be damaged
FEWEST = 16  # lines from which on another order than x y t p is taken if both are possible


class TextLayout(NamedTuple):
    """Layout of the lines of a text.

    Attributes:
        order: what the four numbers are, such as "xytp".
        seconds: whether times are in s; otherwise in µs.
        body: offset of the lines of events, or of comments before them.
        size: (width, height) as the file states them, not checked, or None.
        stated: whether the file states the order.
    """

    order: str
    seconds: bool
    body: int
    size: tuple[bytes, bytes] | None
    stated: bool


def layout_of(head: bytes) -> TextLayout:
    """Return the layout of the text that begins with `head`. ValueError if a line names other columns."""
    at, line, size, names = _first(head)
    words = _words(line)
    # in a comment, or in a line of its own
    for found, body in ((names, at), (words, at + len(line))):
        if named := _named(found):
            order, unit = named
            return TextLayout(order, unit == "s" or (not unit and _has_parts(head[body:], order)), body, size, True)
    if sum(_name_of(word)[0] != "?" for word in words) > 1:
        raise ValueError("a line of names must have x, y, t and p, where t may end in _us or _s")
    if stated := SIZE.fullmatch(line.strip(BETWEEN)):
        return TextLayout("txyp", True, at + len(line), (stated[1], stated[2]), True)
    first = head[at : at + EXAMINED]
    lines = first[: first.rfind(b"\n") + 1] or first
    order, seconds = ("txyp", True) if SECONDS.match(words[0]) else _guessed(lines)
    return TextLayout(order, seconds, at, size, False)


def looks_like(head: bytes, size: int) -> bool:
    """Return whether a file begins, after comments, with four decimal numbers, a size, or the names of four columns."""
    _, line, _, names = _first(head)
    words = _words(line)
    numbers = len(words) == 4 and all(NUMBER.fullmatch(word) for word in words)
    return numbers or any(map(_named, (names, words))) or SIZE.fullmatch(line.strip(BETWEEN)) is not None


def _first(head: bytes) -> tuple[int, bytes, tuple[bytes, bytes] | None, list[bytes]]:
    """Return offset and text of the first line that isn't a comment, and the size and the names in comments before."""
    at = len(MARK) if head.startswith(MARK) else 0
    size, names = None, list[bytes]()
    for line in BytesIO(head[at:]):
        if len(head) >= HEAD and not line.endswith(b"\n"):
            break  # it may be cut
        if line.startswith(COMMENTS):
            names = _words(line[1:])
            if found := GEOMETRY.fullmatch(line.strip()):
                size = found[1], found[2]
        elif line.strip():
            return at, line, size, names
        at += len(line)
    return at, b"", size, []


def _words(line: bytes) -> list[bytes]:
    return SEPARATORS.split(line.strip(BETWEEN), 8)


def _named(words: list[bytes]) -> tuple[str, str] | None:
    """Return the order of four named columns, and the unit of time ("" if it isn't stated); None for other names."""
    found = [_name_of(word) for word in words]
    order = "".join(name for name, _ in found)
    return (order, "".join(unit for _, unit in found)) if sorted(order) == sorted("txyp") else None


def _name_of(word: bytes) -> tuple[str, str]:
    """Return what a column's name means (t, x, y, p or ?), and the unit of time in it."""
    name = word.decode("utf-8", "replace").strip("\"'").lower()
    if name in NAMES or len(name) > LONGEST:
        return NAMES.get(name, "?"), ""
    found = UNIT.fullmatch(name)
    return ("t", "s" if found[2] == "s" else "us") if found and NAMES.get(found[1]) == "t" else ("?", "")


def _has_parts(lines: bytes, order: str) -> bool:
    """Return whether any time is no whole number, and so in s."""
    if b"." not in lines[:EXAMINED]:
        return False
    before = rb"[^ \t,;\r\n]+[ \t,;]+" * order.index("t")
    return re.search(rb"(?m)^[ \t,;]*" + before + rb"-?\d+\.\d*[1-9]", lines[:EXAMINED]) is not None


class _Trial(NamedTuple):
    """Lines read in an order on trial: their number, and the shares of times that don't fall, and that differ."""

    seconds: bool
    lines: int
    rising: float
    different: float

    @property
    def rises(self) -> bool:
        return self.rising >= MAJORITY

    @property
    def has_times(self) -> bool:
        """True if the times are hardly coordinates, which rise by chance, but have few values."""
        return self.rises and self.lines >= FEWEST and self.different > 0.5


def _guessed(lines: bytes) -> tuple[str, bool]:
    """Return the order of the numbers, and whether times are in s.

    The order is x y t p if it explains the lines, unless another one has better times.
    """
    trials = {order: found for order in ("xytp", "txyp", "xypt") if (found := _read(lines, order))}
    own = trials.pop("xytp", None)
    for order, found in sorted(trials.items(), key=lambda item: -item[1].rising):
        if own is None:
            better = found.rises or found.lines >= FEWEST
        else:
            better = found.has_times and not own.has_times and found.rising > own.rising
        if better:
            return order, found.seconds
    return "xytp", own is not None and own.seconds


def _read(lines: bytes, order: str) -> _Trial | None:
    """Read lines in an order; None if some of them can't be read so."""
    seconds, columns = _has_parts(lines, order), Columns.empty(lines.count(b"\n") + 1)
    kept, _, _, dropped = text_decode(np.frombuffer(lines, np.uint8), order, seconds, True, *columns)
    if not kept or kept < MAJORITY * (kept + dropped):
        return None
    t = columns.t[:kept]
    rising = float(np.mean(t[1:] >= t[:-1])) if kept > 1 else 1.0
    return _Trial(seconds, kept, rising, np.unique(t).size / kept)
