"""What the numbers in the lines of a text are: by a header, or by the first lines."""

from __future__ import annotations

import re
from io import BytesIO
from itertools import islice, pairwise
from operator import itemgetter
from statistics import fmean
from typing import NamedTuple

MARK = b"\xef\xbb\xbf"  # byte order mark, with which some programs begin a file
COMMENTS = b"#", b"%"
SEPARATORS = re.compile(rb"[ \t,;]+")
SIZE = re.compile(rb"[ \t]*(\d+)[ \t]+(\d+)[ \t]*")
GEOMETRY = re.compile(rb"%[ \t]*geometry:[ \t]*(\d+)[,x](\d+)")  # as Metavision writes it
NUMBER = re.compile(rb"-?\d{1,18}(\.0*)?")
SECONDS = re.compile(rb"-?\d{1,12}\.\d+")
NAMES = {
    "x": "x",
    "y": "y",
    **dict.fromkeys(("t", "ts", "time", "times", "timestamp", "timestamps", "event_timestamp"), "t"),
    **dict.fromkeys(("p", "pol", "polarity", "polarities"), "p"),
}
UNIT = re.compile(r"(\w+?)[ _]*[\[(]?(us|µs|s)[\])]?")
# orders without a header; each is taken before the next if both are possible
ORDERS = "xytp", "txyp", "xypt"
MOST = 64  # lines that are examined
FEWEST = 16  # lines from which on first numbers may be times
MAJORITY = 0.9  # share of lines that must agree: some may be damaged
FARTHEST = 32_766  # pixels


class TextLayout(NamedTuple):
    """Layout of the lines of a text.

    Attributes:
        order: what the four numbers are, such as "xytp".
        seconds: whether times are in s; otherwise in µs.
        body: offset of the lines of events, or of comments before them.
        size: (width, height) as the file states them, not checked, or None.
    """

    order: str
    seconds: bool
    body: int
    size: tuple[bytes, bytes] | None


def layout_of(head: bytes) -> TextLayout | None:
    """Return the layout of the text that begins with `head`; None if it doesn't seem to be a text of events."""
    at = len(MARK) if head.startswith(MARK) else 0
    size = None
    for line in BytesIO(head[at:]):
        text = line.strip()
        if text and not text.startswith(COMMENTS):
            break
        if found := GEOMETRY.fullmatch(text):
            size = found[1], found[2]
        at += len(line)
    else:
        return None
    if found := SIZE.fullmatch(text):
        return TextLayout("txyp", True, at + len(line), (found[1], found[2]))
    words = SEPARATORS.split(text)
    if named := _named(words):
        order, unit = named
        body = at + len(line)
        fields = _fields(head[body:])[:1]
        seconds = unit == "s" or (not unit and bool(fields) and bool(SECONDS.fullmatch(fields[0][order.index("t")])))
        return TextLayout(order, seconds, body, size)
    if len(words) != 4 or not all(re.fullmatch(rb"-?[\d.]+", word) for word in words):
        return None
    order, seconds = _guessed(_fields(head[at:]))
    return TextLayout(order, seconds, at, size)


def _named(words: list[bytes]) -> tuple[str, str] | None:
    """Return order and unit of time ("" if it isn't stated) by the names of four columns; None for other names."""
    order, unit = "", ""
    for word in words:
        name = word.decode("utf-8", "replace").strip("\"'").lower()
        if name not in NAMES and (found := UNIT.fullmatch(name)) and NAMES.get(found[1]) == "t":
            name, unit = found[1], found[2]
        order += NAMES.get(name, "?")
    return (order, unit) if sorted(order) == sorted("txyp") else None


def _fields(text: bytes) -> list[list[bytes]]:
    """Return the numbers of the first complete lines of four."""
    lines = list(islice(BytesIO(text), MOST))
    if len(lines) > 1 and not lines[-1].endswith(b"\n"):
        # it may be cut
        del lines[-1]
    fields = [SEPARATORS.split(line.strip()) for line in lines if not line.startswith(COMMENTS)]
    numbers = (NUMBER, SECONDS)
    return [line for line in fields if len(line) == 4 and all(any(n.fullmatch(w) for n in numbers) for w in line)]


def _guessed(lines: list[list[bytes]]) -> tuple[str, bool]:
    """Return the order of numbers that explains the lines, and whether times are in s."""
    if lines and SECONDS.fullmatch(lines[0][0]):
        return "txyp", True
    tried = ORDERS if len(lines) >= FEWEST else [order for order in ORDERS if order != "txyp"]
    possible = [order for order in tried if _explained(order, lines) >= MAJORITY]
    rising = [(_rising(order, lines), order) for order in possible]
    # of equal shares, max returns the first
    share, order = max(rising, key=itemgetter(0), default=(0.0, ORDERS[0]))
    if share < MAJORITY:
        order = (possible or ORDERS)[0]
    return order, order == "xypt" and bool(SECONDS.fullmatch(lines[0][3]))


def _explained(order: str, lines: list[list[bytes]]) -> float:
    """Return the share of lines whose coordinates and polarity are in their range if the numbers have this order."""
    whole = "xyp" if order == "xypt" else "txyp"
    return fmean([_is_event(dict(zip(order, line, strict=True)), whole) for line in lines] or [0])


def _is_event(field: dict[str, bytes], whole: str) -> bool:
    if not all(NUMBER.fullmatch(field[name]) for name in whole):
        return False
    x, y, p = (float(field[name]) for name in "xyp")
    return 0 <= x <= FARTHEST and 0 <= y <= FARTHEST and -1 <= p <= 1


def _rising(order: str, lines: list[list[bytes]]) -> float:
    """Return the share of times that aren't before the one of the line above if the numbers have this order."""
    times = [float(line[order.index("t")]) for line in lines]
    return fmean([before <= after for before, after in pairwise(times)] or [1])
