"""Files of a DAVIS camera's raw stream: `nvsdata record` writes one next to its output until the output is complete.

The first line is `#!DAVIS-STREAM1 ` and JSON: `decoder` (the fields of `stream.DavisDecoder`), `last` (µs at which the
recording ends, or null) and `about` (as `Recording.about`). The camera's words follow, 16 bits each, little-endian.
Times are relative to the first reset of the camera's clock in the file; without a reset, they are those of the clock.
If the process is killed, the file may end with half a word, which is ignored.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import fields
from typing import Any

from nvsdata.common.errors import FormatError
from nvsdata.data.events import Columns, Events, concatenate
from nvsdata.data.samples import Frame, Inertial, Piece, within
from nvsdata.formats.file_recording import FileRecording
from nvsdata.formats.registry import Format, starts_with
from nvsdata.kernels.decode.order import is_sorted
from nvsdata.recording.davis.stream import DavisDecoder

MARK = b"#!DAVIS-STREAM1 "
BLOCK = 1 << 20  # bytes that are decoded at once
MAX_SIDE = 4096  # pixels per side


def header(decoder: DavisDecoder, last: int | None, about: Mapping[str, Any]) -> bytes:
    """Return the first line of a file."""
    how = {field.name: getattr(decoder, field.name) for field in fields(DavisDecoder) if field.init}
    return MARK + json.dumps({"decoder": how, "last": last, "about": dict(about)}).encode() + b"\n"


class StreamRecording(FileRecording):
    """Recording from a file of a DAVIS camera's raw stream."""

    format = "davis"
    holds_samples = True
    _rises = True
    _begins = 0  # the reset of the camera's clock; the end is known only after decoding

    def __init__(self, path: str, sensor_size: tuple[int, int] | None, head: bytes, strict: bool) -> None:
        super().__init__(path, sensor_size, strict)
        line, newline, _ = head.partition(b"\n")
        try:
            stated = json.loads(line.removeprefix(MARK))
            self._how = stated["decoder"]
            self._last: int | None = None if stated["last"] is None else int(stated["last"])
            self._about = dict(stated["about"])
            self._check()
            decoder = self._decoder()
        except (ValueError, KeyError, TypeError, AttributeError, OverflowError, RecursionError) as error:
            raise FormatError(path, f"the first line doesn't describe the decoder: {error!r}", offset=0) from None
        if not newline:
            raise FormatError(path, "cut off within the first line", offset=len(line))
        self._begin = len(line) + 1
        self._size = self._size or (decoder.width, decoder.height)

    def _check(self) -> None:
        """Raise ValueError for settings that no camera's decoder has."""
        sides = (self._how["width"], self._how["height"], *(self._how["frame_size"] or ()))
        if len(sides) not in (2, 4) or not all(isinstance(side, int) and 0 < side <= MAX_SIDE for side in sides):
            raise ValueError(f"sides of {sides} pixels")
        others = [value for name, value in self._how.items() if name not in ("width", "height", "frame_size")]
        if not all(isinstance(value, int) and 0 <= value < 1 << 15 for value in others):
            raise ValueError(f"settings {others}")
        if not self._how["steady"]:
            raise ValueError("a decoder that isn't steady: its times may decrease")

    def _decoder(self) -> DavisDecoder:
        return DavisDecoder(**self._how)

    @property
    def about(self) -> Mapping[str, Any]:
        return self._about

    def pieces(self) -> Iterator[Events]:
        """Yield pieces as `Recording.pieces` does, in constant memory."""
        decoder = self._decoder()
        yield Piece.of_camera(Events.empty((decoder.width, decoder.height)), about=self._about)
        yield from self._in_order(decoder, self._last)
        if not decoder.begun:
            # without a reset of the clock, all events are included, in the camera's own time
            decoder = self._decoder()
            decoder.begun = True
            yield from self._in_order(decoder, None)
        for name, count in decoder.error_counts.items():
            self._repair(name, count)

    def _in_order(self, decoder: DavisDecoder, last: int | None) -> Iterator[Piece]:
        """Yield a decoder's events before `last` µs (all if None).

        Decreasing times raise a FormatError, because the file was changed since it was opened.
        """
        latest = 0
        for piece, _ in decoder.decoded(self._blocks(), last):
            if len(piece) and (int(piece.t[0]) < latest or not is_sorted(piece.t)):
                raise FormatError(self.path, "was changed while it was read: open it again")
            latest = int(piece.t[-1]) if len(piece) else latest
            yield piece

    def _blocks(self) -> Iterator[bytes]:
        with open(self.path, "rb", buffering=0) as file:
            file.seek(self._begin)
            while block := file.read(BLOCK):
                if len(block) % 2:
                    block += file.read(1)
                yield block[: len(block) // 2 * 2]

    def decode(self) -> Columns:
        parts, self._ends = [], 0
        for piece in self.pieces():
            parts.append(piece.columns)
            self._ends = max(self._ends, piece.end)
        columns = concatenate(parts)
        return Columns(*self._inside(columns)) if self._size is not None else columns

    @property
    def end(self) -> int:
        _ = self.span
        return super().end

    def frames(self, start: int | None = None, stop: int | None = None) -> Iterator[Frame]:
        return within((f for piece in self.pieces() for f in getattr(piece, "frames", ())), start, stop)

    def inertial(self, start: int | None = None, stop: int | None = None) -> Inertial:
        parts = [piece.inertial for piece in self.pieces() if isinstance(piece, Piece)]
        return Inertial.joined(parts).window(start, stop)


FORMAT = Format("davis", (".davis",), StreamRecording, begins=starts_with(MARK), holds_samples=True)
