"""What cameras record besides events: frames, samples of an inertial unit, and facts about the camera."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, Self

import numpy as np

from nvsdata.data.events import EVER, Events


@dataclass(frozen=True)
class Frame:
    """A picture of a camera that also records events.

    - `start`, `end`: times of the frame's first and last data, in µs of the events' clock
    - `exposure_start`, `exposure_end`: times between which it was exposed, likewise
    - `x`, `y`: the sensor's pixel that is the frame's upper left one
    - `pixels` uint16 [height, width]: bright is large
    """

    start: int
    exposure_start: int
    exposure_end: int
    end: int
    x: int
    y: int
    pixels: np.ndarray

    def shifted(self, time: int) -> Frame:
        """The frame with `time` µs subtracted from its times."""
        times = {name: getattr(self, name) - time for name in ("start", "exposure_start", "exposure_end", "end")}
        return replace(self, **times)


class Inertial(NamedTuple):
    """Samples of an inertial unit.

    - `t` int64 [N]: µs of the events' clock
    - `acceleration`, `rotation` float32 [N, 3]: g and degrees/s
    - `temperature` float32 [N]: °C

    Quantities that the unit doesn't measure are 0.
    """

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
        """The samples selected by a slice or a boolean mask."""
        return Inertial(*(column[which] for column in self))

    def window(self, start: int | None, stop: int | None) -> Inertial:
        """The samples with start <= t < stop (µs); None is without bound."""
        return self.take(_during(self.t, start, stop))

    def shifted(self, time: int) -> Inertial:
        """The samples with `time` µs subtracted from their times."""
        return self._replace(t=self.t - time)


class Triggers(NamedTuple):
    """Signals that came to a camera from outside, such as another camera's exposures.

    - `t` int64 [N]: µs of the events' clock
    - `channel` uint8 [N]: which input
    - `level` uint8 [N]: 1 where it rose, 0 where it fell
    """

    t: np.ndarray
    channel: np.ndarray
    level: np.ndarray

    @classmethod
    def joined(cls, parts: Sequence[Triggers]) -> Triggers:
        """The triggers of all parts, one after the other."""
        none = np.empty(0, np.int64), np.empty(0, np.uint8), np.empty(0, np.uint8)
        return cls(*map(np.concatenate, zip(none, *parts, strict=True)))

    def window(self, start: int | None, stop: int | None) -> Triggers:
        """The triggers with start <= t < stop (µs); None is without bound."""
        which = _during(self.t, start, stop)
        return Triggers(*(column[which] for column in self))


class Piece(Events):
    """Events together with what else a camera sent: `frames`, `inertial`, and facts about the camera (`about`).

    `about` is as in `Recording.about`; in a sequence of pieces, later ones add to it.
    """

    __slots__ = ("about", "frames", "inertial")

    frames: Sequence[Frame]
    inertial: Inertial
    about: Mapping[str, Any]

    @classmethod
    def beside(
        cls, events: Events, frames: Sequence[Frame] = (), inertial: Inertial | None = None, about: Any = None
    ) -> Self:
        """A piece of these events with the other data; columns are shared."""
        piece = cls.__new__(cls)
        for name in Events.__slots__:
            setattr(piece, name, getattr(events, name))
        piece.frames, piece.inertial, piece.about = frames, inertial or Inertial.empty(), about or {}
        return piece

    @property
    def bare(self) -> bool:
        """Whether the piece holds nothing: neither events nor other data."""
        return not (len(self) or len(self.frames) or self.inertial.t.size or self.about)


def without_samples(events: Events) -> Events:
    """The events without other data, for formats that hold nothing else."""
    return events.of(events.columns) if isinstance(events, Piece) else events


def is_bare(events: Events) -> bool:
    """Whether a piece has nothing to write."""
    return events.bare if isinstance(events, Piece) else len(events) == 0


def within(frames: Iterable[Frame], start: int | None, stop: int | None) -> Iterator[Frame]:
    """The frames whose exposure begins at start <= t < stop (µs); None is without bound."""
    return (frame for frame in frames if _least(start) <= frame.exposure_start < _most(stop))


def _during(t: np.ndarray, start: int | None, stop: int | None) -> np.ndarray:
    """Mask of the times with start <= t < stop (µs); None is without bound."""
    mask: np.ndarray = (t >= _least(start)) & (t < _most(stop))
    return mask


def _least(time: int | None) -> int:
    return EVER[0] if time is None else time


def _most(time: int | None) -> int:
    return EVER[1] if time is None else time
