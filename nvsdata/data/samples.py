"""What cameras record beside events: frames, and samples of an inertial unit; and what is known of the camera."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from datetime import datetime, timedelta
from typing import Any, NamedTuple, Self

import numpy as np

from nvsdata.data.events import EVER, Columns, Events, Recording


@dataclass(frozen=True)
class Frame:
    """A picture of a camera that records events, too.

    `pixels` uint16 [height, width], bright is large; its upper left one lies at (`x`, `y`) of the sensor. Times are in
    µs, in the clock of the events: of the frame's first and last data, and between them of the exposure.
    """

    start: int
    exposure_start: int
    exposure_end: int
    end: int
    x: int
    y: int
    pixels: np.ndarray

    def shifted(self, time: int) -> Frame:
        """The frame with `time` µs taken off its times."""
        times = {name: getattr(self, name) - time for name in ("start", "exposure_start", "exposure_end", "end")}
        return replace(self, **times)


class Inertial(NamedTuple):
    """Samples of an inertial unit: `t` int64 [N], µs in the clock of the events; `acceleration` (g) and `rotation`
    (degrees/s) float32 [N, 3], `temperature` (°C) float32 [N]. What the unit doesn't measure is 0."""

    t: np.ndarray
    acceleration: np.ndarray
    rotation: np.ndarray
    temperature: np.ndarray

    @classmethod
    def empty(cls) -> Inertial:
        """No samples."""
        vectors = np.empty((0, 3), np.float32)
        return cls(np.empty(0, np.int64), vectors, vectors, np.empty(0, np.float32))

    @classmethod
    def joined(cls, parts: Sequence[Inertial]) -> Inertial:
        """The samples of all parts, one after the other."""
        return cls(*map(np.concatenate, zip(*parts, strict=True))) if parts else cls.empty()

    def at(self, which: slice | np.ndarray) -> Inertial:
        """The samples under a slice or a boolean mask."""
        return Inertial(*(column[which] for column in self))

    def window(self, start: int | None, stop: int | None) -> Inertial:
        """The samples with start <= t < stop; None is without bound."""
        return self.at((self.t >= _least(start)) & (self.t < _most(stop)))

    def shifted(self, time: int) -> Inertial:
        """The samples with `time` µs taken off their times."""
        return self._replace(t=self.t - time)


class Piece(Events):
    """Events with what a camera sent beside them: `frames`, `inertial`, and what is known of it (`about`).

    `about` is as `Recording.about`; where pieces follow each other, the later ones add to it.
    """

    __slots__ = ("about", "frames", "inertial")

    frames: Sequence[Frame]
    inertial: Inertial
    about: Mapping[str, Any]

    @classmethod
    def beside(
        cls, events: Events, frames: Sequence[Frame] = (), inertial: Inertial | None = None, about: Any = None
    ) -> Self:
        """The events with these beside them; columns are shared."""
        piece = cls.__new__(cls)
        for name in Events.__slots__:
            setattr(piece, name, getattr(events, name))
        piece.frames, piece.inertial, piece.about = frames, inertial or Inertial.empty(), about or {}
        return piece

    @property
    def bare(self) -> bool:
        """Whether there is nothing in it, not even beside events."""
        return not (len(self) or len(self.frames) or self.inertial.t.size or self.about)


def without_samples(events: Events) -> Events:
    """The events alone, for formats that hold nothing else."""
    return events.of(events.columns) if isinstance(events, Piece) else events


def is_bare(events: Events) -> bool:
    """Whether a piece has nothing to be written."""
    return events.bare if isinstance(events, Piece) else len(events) == 0


def within(frames: Iterable[Frame], start: int | None, stop: int | None) -> Iterator[Frame]:
    """The frames whose exposure begins at start <= t < stop (µs); None is without bound."""
    return (frame for frame in frames if _least(start) <= frame.exposure_start < _most(stop))


class _Passing:
    """Frames and inertial samples of a recording, read once and handed out as its time passes."""

    def __init__(self, recording: Recording, start: int | None = None, stop: int | None = None) -> None:
        inertial = recording.inertial(start, stop)
        self._inertial = inertial.at(np.argsort(inertial.t, kind="stable"))
        self._frames = recording.frames(start, stop)
        self._next = next(self._frames, None)

    def first(self) -> list[int]:
        """Times of the next frame and the next sample, as far as there are any."""
        times = self._inertial.t[:1].tolist()
        return times if self._next is None else [*times, self._next.exposure_start]

    def until(self, last: int) -> tuple[list[Frame], Inertial]:
        """What is left up to a time in µs, which belongs to it."""
        frames = []
        while self._next is not None and self._next.exposure_start <= last:
            frames.append(self._next)
            self._next = next(self._frames, None)
        count = int(self._inertial.t.searchsorted(last, "right"))
        samples, self._inertial = self._inertial.at(slice(count)), self._inertial.at(slice(count, None))
        return frames, samples


def in_pieces(recording: Recording, every: int = 1_000_000) -> Iterator[Piece]:
    """A recording with its frames and inertial samples, `every` µs at once; last comes what is known of the camera.

    Events are decoded as a whole, so that damage is told of before any are handed out. Where there is nothing for a
    long time, no pieces are.
    """
    events, beside, done = recording.read(), _Passing(recording), 0
    while times := [*events.t[done : done + 1].tolist(), *beside.first()]:
        last = min(min(times) + every - 1, EVER[1])
        count = int(events.t.searchsorted(last, "right"))
        end = max(events.start, min(last, events.end))
        piece = Events.trusted(events.columns.at(slice(done, count)), events.sensor_size, events.start, end)
        yield Piece.beside(piece, *beside.until(last))
        done = count
    yield Piece.beside(Events.empty(events.sensor_size, events.start, events.end), about=recording.about)


def cut(recording: Recording, start: int, stop: int, every: int = 1_000_000) -> Iterator[Events]:
    """A recording from `start` to `stop` (µs), `every` µs at once, with times counted from `start`.

    Frames belong to where their exposure begins; `about` tells when the cut began.
    """
    about = later(recording.about, start)
    beside = _Passing(recording, start, stop) if recording.holds_samples else None
    for begin in range(start, stop, every):
        end = min(begin + every, stop)
        events = recording.read(begin, end)
        columns = Columns(events.t - start, events.x, events.y, events.p)
        shifted = Events.trusted(columns, events.sensor_size, begin - start, events.end - start)
        if beside is not None:
            frames, inertial = beside.until(end - 1)
            shifted = Piece.beside(shifted, [f.shifted(start) for f in frames], inertial.shifted(start), about)
            about = {}
        yield shifted


def later(about: Mapping[str, Any], time: int) -> dict[str, Any]:
    """What is known of a camera, for a recording whose time 0 is `time` µs later."""
    moved = dict(about)
    with suppress(KeyError, TypeError, ValueError):
        began = datetime.fromisoformat(moved["started"])
        moved["started"] = (began + timedelta(microseconds=time)).isoformat(timespec="microseconds")
    return moved


def _least(time: int | None) -> int:
    return EVER[0] if time is None else time


def _most(time: int | None) -> int:
    return EVER[1] if time is None else time
