"""Pieces of events that are checked while they are written, and headers with the facts about all pieces."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from itertools import chain
from pathlib import Path
from typing import IO

from nvsdata.data.events import LATEST, Events
from nvsdata.data.samples import is_empty

_TIME = re.compile(r"[#%] nvsdata time +(-?\d+) to +(-?\d+) us")


class Pieces:
    """Pieces of a stream of events, to be iterated over once. Empty pieces are left out.

    Attributes:
        sensor_size: (width, height) of the first piece, even if it is empty.
        start: Start in µs of the pieces so far.
        end: End in µs of the pieces so far.
        count: Number of events so far.
        last: The last piece with events so far; None before the first.

    Raises:
        ValueError: If there is no piece; during iteration, if pieces are of different sensors, out of order, or have
            times at or beyond 2^62 µs.
    """

    def __init__(self, pieces: Iterable[Events]) -> None:
        self._waiting = iter(pieces)
        first = next(self._waiting, None)
        if first is None:
            raise ValueError("there are no pieces to write; at least an empty one must state the sensor")
        self._waiting = chain((first,), self._waiting)
        self.sensor_size, self.start, self.end = first.sensor_size, first.start, first.end
        self.count = 0
        self.last: Events | None = None

    def __iter__(self) -> Iterator[Events]:
        for piece in self._waiting:
            if piece.sensor_size != self.sensor_size:
                raise ValueError(f"pieces of different sensors: {self.sensor_size} and {piece.sensor_size}")
            self.end = max(self.end, piece.end)
            if is_empty(piece):
                continue
            if len(piece):
                self._check(piece)
            yield piece

    def _check(self, piece: Events) -> None:
        """Check that a piece continues the pieces before it, and count its events."""
        if not -LATEST < piece.t[0] <= piece.t[-1] < LATEST:
            raise ValueError(f"times from {piece.t[0]} to {piece.t[-1]} µs: files support times below 2^62 only")
        if self.last is not None and piece.t[0] < self.last.t[-1]:
            raise ValueError(f"a piece begins at {piece.t[0]} µs, but the one before it ends at {self.last.t[-1]} µs")
        self.start, self.end = min(self.start, int(piece.t[0])), max(self.end, int(piece.t[-1]))
        self.count += len(piece)
        self.last = piece


@contextmanager
def file_with_header(path: Path, pieces: Pieces, header: Callable[[Pieces], bytes]) -> Iterator[IO[bytes]]:
    """Create a file that begins with `header`; the block writes the pieces to it.

    The header is written again at the end, when all pieces are known, so its length must not change.
    """
    with path.open("wb") as file:
        begin = header(pieces)
        file.write(begin)
        yield file
        final = header(pieces)
        assert len(final) == len(begin), "a header that grew would overwrite events"
        file.seek(0)
        file.write(final)


def time_comment(pieces: Pieces, mark: str = "#") -> str:
    """Return a comment line of a header, without line end, that states the time range of the pieces.

    Its length doesn't depend on the numbers, because these are known only at the end.
    """
    return f"{mark} nvsdata time {pieces.start:>20} to {pieces.end:>20} us"


def stated_time(lines: Iterable[str]) -> tuple[int, int] | None:
    """Return the first and last moment in µs that a header's `time_comment` states; None if there is no such line."""
    return next(((int(m[1]), int(m[2])) for line in lines if (m := _TIME.fullmatch(line.rstrip()))), None)
