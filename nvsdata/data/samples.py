"""What cameras record beside events: frames, and samples of an inertial unit; and what is known of the camera."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, Self

import numpy as np

from nvsdata.data.events import EVER, Events


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

    def take(self, which: slice | np.ndarray) -> Inertial:
        """The samples under a slice or a boolean mask."""
        return Inertial(*(column[which] for column in self))

    def window(self, start: int | None, stop: int | None) -> Inertial:
        """The samples with start <= t < stop; None is without bound."""
        return self.take((self.t >= _least(start)) & (self.t < _most(stop)))

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


def _least(time: int | None) -> int:
    return EVER[0] if time is None else time


def _most(time: int | None) -> int:
    return EVER[1] if time is None else time
