"""Frames and inertial samples among the records of AEDAT 2.0, in jAER's encoding (bit 31 of the address is set).

- A frame has two records per pixel, a reading before the exposure (bits 10-11 are 0) and one after it (1), in bits 0-9.
  x (bits 12-21) is not mirrored, unlike the x of events; y (bits 22-30) counts from the bottom. The brightness of a
  pixel is the difference of the readings. The four times of a frame are those of the first and last reading before the
  exposure, and of the first and last reading after it.
- An inertial sample has seven records (bits 10-11 are 3), numbered in bits 28-30, with 16 bits of acceleration,
  temperature (340 per °C, from 35 °C) or rotation in bits 12-27. The preferences in the header state the full scale,
  the value of 2^15; without them it is jAER's default, 8 g and 1,000 degrees/s. Axes are those of the inertial unit.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from typing import Any, NamedTuple

import numpy as np

from nvsdata.data.events import LATEST, Events
from nvsdata.data.samples import Frame, Inertial, Piece
from nvsdata.kernels.decode.aedat2 import DAVIS, aedat2_encode
from nvsdata.kernels.decode.aedat_frames import FRAME_FACTS, next_frame
from nvsdata.kernels.decode.order import is_sorted

NOT_EVENT, BEFORE, AFTER, INERTIAL = 1 << 31, 0 << 10, 1 << 10, 3 << 10
KINDS = 3 << 10
MAX_READING = 1023
DEPTH = 6  # bits: a frame's pixels have 16, a reading has 10
FULL = 1 << 15
PER_KELVIN, ZERO = 340.0, 35.0
_SCALE = re.compile(r'#.*key="Imu(Accel|Gyro)Scale" value="(?:ImuAccelScaleG|GyroFullScaleDegPerSec)(\d{1,5})"')
PATIENCE = 1_000_000  # µs that records wait for a frame that began before them, as long as no frame has arrived
LONGEST = 10_000_000  # µs that records wait for such a frame, after a frame has arrived


Timed = Iterator[tuple[np.ndarray, np.ndarray]]  # records, piece by piece: bytes or addresses, and times in µs, int64


class Scales(NamedTuple):
    """Full scale (the value of 2^15): acceleration in g, rotation in degrees/s."""

    g: float = 8.0
    degrees: float = 1000.0

    @classmethod
    def stated(cls, lines: Iterable[str]) -> Scales:
        """Return the scales that a header states; jAER's defaults if it states none."""
        found = {match[1]: float(match[2]) for line in lines if (match := _SCALE.match(line)) and int(match[2])}
        return cls(found.get("Accel", cls().g), found.get("Gyro", cls().degrees))

    @property
    def lines(self) -> tuple[str, str]:
        """Header lines that state the scales."""
        return (
            f'#<entry key="ImuAccelScale" value="ImuAccelScaleG{self.g:.0f}"/>',
            f'#<entry key="ImuGyroScale" value="GyroFullScaleDegPerSec{self.degrees:.0f}"/>',
        )


WRITTEN = Scales(4.0, 500.0)  # the scales that nvsdata sets on a DAVIS


class Records(NamedTuple):
    """Records with their times.

    Args:
        t: int64 [N], µs.
        raw: uint64 [N], bytes of the records in a file.
    """

    t: np.ndarray
    raw: np.ndarray


def merged_records(pieces: Iterable[Events], layout: int, size: tuple[int, int]) -> Iterator[Any]:
    """Yield the `Records` of pieces, sorted by time: a frame arrives after events that are later than its first data.

    ValueError for frames and inertial samples in the layout of a DVS128, which has none.
    """
    queue = _RecordQueue(layout, size)
    for piece in pieces:
        if isinstance(piece, Piece):
            yield from queue.add(piece)
        elif len(piece):
            yield from queue.take(None)
            yield queue.events(piece)
    yield from queue.take(None)


class _RecordQueue:
    """Records that wait until no earlier record can arrive. They are sorted once per half of `PATIENCE`."""

    def __init__(self, layout: int, size: tuple[int, int]) -> None:
        self._layout, self._size = layout, size
        self._waiting: list[Records] = []
        self._due = -LATEST  # records are sorted when a piece ends after this time
        self._framed = -LONGEST  # end of the last frame
        self._patience = PATIENCE
        self._last = 0

    def events(self, piece: Events) -> Records:
        """Return the records of a piece's events."""
        raw = aedat2_encode(*piece.columns, self._layout, *self._size)
        return Records(piece.t, raw.view(np.uint64).reshape(-1))

    def add(self, piece: Piece) -> Iterator[Records]:
        """Add the records of a piece, and yield the waiting records that no record of a later piece can precede."""
        self._waiting.append(self.events(piece))
        for t, addresses in (*self._inertial(piece.inertial), *self._frames(piece.frames)):
            # a frame may have begun before time 0, or have lasted longer than records wait
            t = np.maximum(t, self._last)
            words = np.stack((addresses, t & 0xFFFFFFFF), axis=1).astype(">u4")
            self._waiting.append(Records(t, words.view(np.uint64).reshape(-1)))
        if piece.end >= self._due:
            self._due = piece.end + PATIENCE // 2
            yield from self.take(min(max(self._framed, piece.end - self._patience), piece.end))

    def take(self, until: int | None) -> Iterator[Records]:
        """Yield the waiting records before the time `until` (µs), sorted; all of them for None."""
        if not self._waiting:
            return
        t, raw = (np.concatenate(column) for column in zip(*self._waiting, strict=True))
        if not is_sorted(t):
            order = np.argsort(t, kind="stable")
            t, raw = t[order], raw[order]
        count = t.size if until is None else int(t.searchsorted(until))
        self._waiting = [Records(t[count:], raw[count:])] if count < t.size else []
        if count:
            self._last = int(t[count - 1])
            yield Records(t[:count], raw[:count])

    def _inertial(self, samples: Inertial) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        if samples.t.size:
            self._check_layout("inertial samples")
            values = np.concatenate(
                (
                    samples.acceleration * (FULL / WRITTEN.g),
                    (samples.temperature[:, None] - ZERO) * PER_KELVIN,
                    samples.rotation * (FULL / WRITTEN.degrees),
                ),
                axis=1,
            )
            words = np.clip(np.rint(values), -FULL, FULL - 1).astype(np.int64) & 0xFFFF
            yield samples.t.repeat(7), (NOT_EVENT | INERTIAL | np.arange(7) << 28 | words << 12).ravel()

    def _frames(self, frames: Iterable[Frame]) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        for frame in frames:
            self._check_layout("frames")
            height, width = frame.pixels.shape
            # column by column, from the top
            column = frame.x + np.arange(width).repeat(height)
            row = self._size[1] - 1 - frame.y - np.tile(np.arange(height), width)
            place = NOT_EVENT | row << 22 | column << 12
            light = (frame.pixels.T.ravel() >> DEPTH).astype(np.int64)
            for kind, reading, ends in (
                (BEFORE, np.full_like(light, MAX_READING), (frame.start, frame.exposure_start)),
                (AFTER, MAX_READING - light, (frame.exposure_end, frame.end)),
            ):
                # the exposure is defined by the times of the first and the last reading only
                t = np.full(light.size, ends[kind == BEFORE], np.int64)
                t[0 if kind == BEFORE else -1] = ends[kind != BEFORE]
                yield t, place | kind | reading
            self._framed, self._patience = frame.end, LONGEST

    def _check_layout(self, what: str) -> None:
        if self._layout != DAVIS:
            raise ValueError(f"AEDAT 2.0 of a sensor up to 128x128 is written as a DVS128's, which has no {what}")


def davis_inertial(timed: Timed, scales: Scales) -> Inertial:
    """Return the inertial samples among the records of a file; incomplete ones are left out."""
    parts = []
    rest_t, rest = np.empty(0, np.int64), np.empty(0, np.uint32)
    for addresses, t in _not_events(timed):
        mine = (addresses & KINDS) == INERTIAL
        t, addresses = np.concatenate((rest_t, t[mine])), np.concatenate((rest, addresses[mine]))
        code = addresses >> 28 & 7
        firsts = np.flatnonzero(code == 0)
        whole = firsts[firsts + 7 <= code.size]
        rows = whole[:, None] + np.arange(7)
        rows = rows[(code[rows] == np.arange(7)).all(axis=1)]
        words = (addresses[rows] >> 12 & 0xFFFF).astype(np.uint16).view(np.int16).astype(np.float32)
        temperature = words[:, 3] / np.float32(PER_KELVIN) + np.float32(ZERO)
        acceleration, rotation = (
            words[:, :3] / np.float32(FULL / scales.g),
            words[:, 4:] / np.float32(FULL / scales.degrees),
        )
        parts.append(Inertial(t[rows[:, 0]], acceleration, rotation, temperature))
        keep = firsts[firsts + 7 > code.size]
        cut = int(keep[0]) if keep.size else code.size
        rest_t, rest = t[cut:], addresses[cut:]
    return Inertial.joined(parts)


def davis_frames(timed: Timed, size: tuple[int, int]) -> Iterator[Frame]:
    """Yield the frames among the records of a file; frames with missing pixels are left out."""
    found = _whole_frames(timed, size)
    first, second = next(found, None), next(found, None)
    # the rest of a frame that began before the file looks like a frame of a smaller region
    if first is not None and (second is None or first.pixels.size >= second.pixels.size):
        yield first
    if second is not None:
        yield second
    yield from found


def _whole_frames(timed: Timed, size: tuple[int, int]) -> Iterator[Frame]:
    width, height = size
    before, light = np.zeros((height, width), np.uint16), np.zeros((height, width), np.uint16)
    state, facts = np.zeros((height, width), np.uint8), np.zeros(FRAME_FACTS, np.int64)
    for addresses, t in _not_events(timed):
        mine = (addresses & KINDS) <= AFTER
        t, addresses = t[mine], addresses[mine]
        at = 0
        while at < t.size:
            at, found = next_frame(addresses, t, at, before, light, state, facts)
            if found:
                yield _frame(facts, light)
    # the last frame ends with the file
    if next_frame(np.zeros(0, np.uint32), np.zeros(0, np.int64), 0, before, light, state, facts)[1]:
        yield _frame(facts, light)


def _frame(facts: np.ndarray, light: np.ndarray) -> Frame:
    start, exposure_start, exposure_end, end, left, top, right, bottom = facts[:8].tolist()
    return Frame(
        start, exposure_start, exposure_end, end, left, top, light[top : bottom + 1, left : right + 1] << DEPTH
    )


def _not_events(timed: Timed) -> Timed:
    """Yield the records of a file that aren't events: their addresses, uint32, and times in µs."""
    for raw, t in timed:
        addresses = raw.view(">u4")[::2].astype(np.uint32)
        which = addresses >= NOT_EVENT
        yield addresses[which], t[which]
