"""Decoder of a DAVIS camera's stream: from bytes to events, special events, inertial samples and frames.

The stream is that of logic version 18: 16-bit words in the vendor's coding. Any split of the stream into pieces of
whole words has the same result.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from nvsdata.data.events import Columns, Events
from nvsdata.data.samples import Frame, Inertial, Piece, within
from nvsdata.formats.contents import most_bytes
from nvsdata.kernels.recording import davis_stream as kernel

ROOM = 1024  # largest number of special events, and of samples, per call of the kernel
SPECIALS = {
    kernel.WRAP: "timestamp_wrap",
    kernel.RESET: "timestamp_reset",
    kernel.RISING: "external_rising",
    kernel.FALLING: "external_falling",
    kernel.PULSE: "external_pulse",
    kernel.GENERATOR_RISING: "generator_rising",
    kernel.GENERATOR_FALLING: "generator_falling",
    kernel.FRAME_START_EVENT: "frame_start",
    kernel.FRAME_END_EVENT: "frame_end",
    kernel.EXPOSURE_START_EVENT: "exposure_start",
    kernel.EXPOSURE_END_EVENT: "exposure_end",
}
ERRORS = {
    kernel.ROW_OUT_OF_RANGE: "row_out_of_range",
    kernel.COLUMN_OUT_OF_RANGE: "column_out_of_range",
    kernel.TIME_NOT_RISING: "time_not_rising",
    kernel.UNKNOWN_SPECIAL: "unknown_special",
    kernel.UNKNOWN_DATA: "unknown_data",
    kernel.SURPLUS_PIXELS: "surplus_pixels",
    kernel.SHORT_COLUMNS: "short_columns",
    kernel.BROKEN_FRAMES: "broken_frames",
    kernel.BROKEN_SAMPLES: "broken_samples",
    kernel.LOST_WRAPS: "lost_wraps",
    kernel.LATE_RESETS: "late_resets",
}


class Specials(NamedTuple):
    """Special events, int64 [n] each.

    Args:
        word: Number of the word with which each was sent, counted from the start of the stream.
        t: Time (µs).
        kind: Type, a key of `SPECIALS`.
        before: Number of events in the result of the same `feed` that precede each.
    """

    word: np.ndarray
    t: np.ndarray
    kind: np.ndarray
    before: np.ndarray


NONE = np.empty(0, np.int64)
NO_SPECIALS = Specials(NONE, NONE, NONE, NONE)


@dataclass
class DavisDecoder:
    """Decoder of a camera's stream, piece by piece.

    `feed` returns the events of a piece, in the order of the stream. Times (µs) restart at a "timestamp_reset";
    elsewhere they decrease only in damaged streams. After `feed`, `specials`, `samples` and `frames` contain the other
    data of the piece, and `sample_words` and `frame_words` the numbers of the words at which samples and frames ended.
    `begun` is True if `decoded` has found a reset of the clock; if it is set to True before, data before the reset are
    included.

    `error_counts` counts faults since the start, by name: addresses that don't exist, unknown words, incomplete frames
    and samples (which are dropped), columns of a frame with too few pixels (the other pixels keep earlier values), and
    pieces with half a word at the end (which is dropped).

    Args:
        width: Width of the sensor in pixels, after the swap of axes.
        height: Height of the sensor in pixels, after the swap of axes.
        swap: Swap the axes: rows of the sensor become columns of the events (default False).
        frame_size: (width, height) of frames in pixels, after a swap of their axes (default: those of the sensor).
        frame_orientation: Value of register 2/2: a sum of 4 (swap), 2 (flip x) and 1 (flip y) (default 0).
        chip: Value of register 6/1, the number of the sensor (default 2).
        inertial: Value of register 3/0, the type of the inertial unit (default 1).
        inertial_flips: Value of register 3/1: a sum of 4 (flip x), 2 (flip y) and 1 (flip z) (default 0).
        steady: Never let times decrease (default False). If parts of the stream are missing, times continue from the
            next wrap of the camera's clock that fits (counted as "lost_wraps"). They also continue after every reset
            except the first (counted as "late_resets").
    """

    width: int
    height: int
    swap: bool = False
    frame_size: tuple[int, int] | None = None
    frame_orientation: int = 0
    chip: int = 2
    inertial: int = 1
    inertial_flips: int = 0
    steady: bool = False
    words: int = field(default=0, init=False)
    begun: bool = field(default=False, init=False)
    specials: Specials = field(init=False)
    samples: Inertial = field(init=False)
    sample_words: np.ndarray = field(init=False)
    frames: list[Frame] = field(default_factory=list, init=False)
    frame_words: list[int] = field(default_factory=list, init=False)

    def __post_init__(self) -> None:
        columns, rows = (self.height, self.width) if self.swap else (self.width, self.height)
        wide, high = self.frame_size or (self.width, self.height)
        flips = self.frame_orientation >> 2 & 1, self.frame_orientation >> 1 & 1, self.frame_orientation & 1
        # the converter of the DAVIS240 has one bit less
        factor = 2 if self.chip in (0, 1, 2) else 1
        self._setting = np.array([columns, rows, wide, high, *flips, factor, self.steady], np.int64)
        self._state = np.zeros(kernel.STATES, np.int64)
        self._counts = np.zeros(kernel.ERRORS, np.int64)
        self._odd = 0
        self._pixels = np.zeros(wide * high, np.uint16)
        self._scratch = Columns.empty(0)
        self._specials = np.empty((ROOM, 4), np.int64)
        self._samples = np.empty((ROOM, 12), np.int64)
        self._note([], [])

    @property
    def error_counts(self) -> dict[str, int]:
        """Number of faults of each kind, by name."""
        return {name: int(self._counts[i]) for i, name in ERRORS.items()} | {"odd_bytes": self._odd}

    @property
    def now(self) -> int:
        """The camera's time (µs) at the end of the last piece."""
        return int(self._state[kernel.NOW])

    def feed(self, data: bytes | bytearray | memoryview | np.ndarray) -> Events:
        """Decode the next piece of the stream; return its events, with `start` 0 and `sensor_size` (width, height)."""
        piece = np.frombuffer(data, np.uint8)
        self._odd += piece.size % 2
        words = piece[: piece.size // 2 * 2].view("<u2")
        if words.size > self._scratch.t.size:
            # this buffer is used for every piece, because new memory would take longer than the decoding
            self._scratch = Columns.empty(words.size)
        notes: list[np.ndarray] = []
        rows: list[np.ndarray] = []
        self.frames, self.frame_words = [], []
        at = count = 0
        # frames may be incomplete, so a few words could claim many large frames
        room = most_bytes(words.nbytes)
        while at < words.size:
            at, events, specials, samples, whole = kernel.decode(
                words,
                at,
                self._state,
                self._counts,
                self._setting,
                self._pixels,
                *self._scratch.take(slice(count, None)),
                self._specials,
                self._samples,
            )
            if specials:
                self._specials[:specials, 3] += count
                notes.append(self._specials[:specials].copy())
            if samples:
                rows.append(self._samples[:samples].copy())
            room -= self._frame_size if whole else 0
            if whole and room < 0:
                self._counts[kernel.BROKEN_FRAMES] += 1
            elif whole:
                self.frames.append(self._frame())
                self.frame_words.append(self.words + at - 1)
            count += events
        self._note(notes, rows)
        self.words += words.size
        columns = Columns(*(column[:count].copy() for column in self._scratch))
        if self.swap:
            columns = columns._replace(x=columns.y, y=columns.x)
        return Events.trusted(columns, (self.width, self.height), 0)

    def decoded(self, blocks: Iterable[bytes], last: int | None) -> Iterator[tuple[Piece, np.ndarray]]:
        """Yield the contents of blocks of words, and the times (µs, int64) of pulses and rising edges at the input.

        Times are relative to the first reset of the camera's clock. Data before this reset are left out, and so are
        data from time `last` (µs) on. The split of the stream into blocks doesn't change the joined result.

        Raises:
            ValueError: The decoder isn't `steady`, so events may be out of order.
        """
        if not self.steady:
            raise ValueError("only a steady decoder returns events in order: DavisDecoder(steady=True)")
        size = (self.width, self.height)
        for block in blocks:
            events = self.feed(block)
            specials, samples, frames = self.specials, self.samples, self.frames
            kept, triggers = slice(None), (specials.kind == kernel.RISING) | (specials.kind == kernel.PULSE)
            if not self.begun:
                resets = np.flatnonzero(specials.kind == kernel.RESET)
                if not resets.size:
                    continue
                self.begun, word = True, int(specials.word[resets[0]])
                kept = slice(int(specials.before[resets[0]]), None)
                triggers &= specials.word > word
                samples = samples.take(self.sample_words > word)
                frames = [frame for frame, at in zip(frames, self.frame_words, strict=True) if at > word]
            columns = events.columns.take(kept)
            times = specials.t[triggers]
            if last is not None:
                columns = columns.first(int(np.searchsorted(columns.t, last)))
                samples, times = samples.window(None, last), times[times < last]
                frames = list(within(frames, None, last))
            about = {"temperature": float(samples.temperature[-1])} if samples.t.size else {}
            end = self.now if last is None else min(self.now, last - 1)
            yield Piece.of_camera(Events.trusted(columns, size, 0, end), frames, samples, about), times

    def _note(self, notes: list[np.ndarray], rows: list[np.ndarray]) -> None:
        """Join the special events and samples of a piece."""
        self.specials, self.samples, self.sample_words = NO_SPECIALS, Inertial.empty(), NONE
        if notes:
            word, t, kind, before = (notes[0] if len(notes) == 1 else np.concatenate(notes)).T
            self.specials = Specials(self.words + word, t, kind, before)
        if rows:
            found = rows[0] if len(rows) == 1 else np.concatenate(rows)
            self.samples, self.sample_words = self._measured(found), self.words + found[:, 0]

    def _measured(self, rows: np.ndarray) -> Inertial:
        """Convert the kernel's inertial samples to physical units."""
        n = len(rows)
        measures = np.empty((n, 3), np.float32), np.empty((n, 3), np.float32), np.empty(n, np.float32)
        slope, zero = (333.87, 21) if self.inertial == 2 else (340, 35)
        kernel.measure(rows, self.inertial_flips, slope, zero, *measures)
        return Inertial(rows[:, 1], *measures)

    @property
    def _frame_size(self) -> int:
        """Size in bytes of the pixels of a frame, for the current region."""
        return 2 * int(self._state[kernel.SIZE_X]) * int(self._state[kernel.SIZE_Y])

    def _frame(self) -> Frame:
        state = self._state
        wide, high = int(state[kernel.SIZE_X]), int(state[kernel.SIZE_Y])
        return Frame(
            int(state[kernel.FRAME_START]),
            int(state[kernel.EXPOSURE_START]),
            int(state[kernel.EXPOSURE_END]),
            self.now,
            int(state[kernel.LEFT]),
            int(state[kernel.TOP]),
            self._pixels[: wide * high].reshape(high, wide).copy(),
        )
