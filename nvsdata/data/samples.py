"""Other data of event cameras: frames, samples of an inertial unit (IMU), external triggers, metadata."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, Self

import numpy as np

from nvsdata.data.events import EVER, Events


@dataclass(frozen=True)
class Frame:
    """A frame of a camera that also records events.

    Args:
        start: Time of the frame's first data, in µs of the events' clock.
        exposure_start: Start of the exposure, in µs.
        exposure_end: End of the exposure, in µs.
        end: Time of the frame's last data, in µs.
        x: Column, on the sensor, of the frame's top left pixel.
        y: Row, on the sensor, of the frame's top left pixel.
        pixels: uint16 [height, width]; larger is brighter.
    """

    start: int
    exposure_start: int
    exposure_end: int
    end: int
    x: int
    y: int
    pixels: np.ndarray

    def shifted(self, time: int) -> Frame:
        """Return the frame with `time` µs subtracted from its times."""
        times = {name: getattr(self, name) - time for name in ("start", "exposure_start", "exposure_end", "end")}
        return replace(self, **times)


class Inertial(NamedTuple):
    """Samples of an inertial unit (IMU). Quantities that the unit doesn't measure are 0.

    Args:
        t: Times in µs of the events' clock, int64 [N].
        acceleration: g, float32 [N, 3].
        rotation: degrees/s, float32 [N, 3].
        temperature: °C, float32 [N].
    """

    t: np.ndarray
    acceleration: np.ndarray
    rotation: np.ndarray
    temperature: np.ndarray

    @classmethod
    def empty(cls) -> Inertial:
        """Return an `Inertial` without samples."""
        vectors = np.empty((0, 3), np.float32)
        return cls(np.empty(0, np.int64), vectors, vectors, np.empty(0, np.float32))

    @classmethod
    def joined(cls, parts: Sequence[Inertial]) -> Inertial:
        """Concatenate samples."""
        return cls(*map(np.concatenate, zip(*parts, strict=True))) if parts else cls.empty()

    def take(self, which: slice | np.ndarray) -> Inertial:
        """Return the samples selected by a slice or a boolean mask."""
        return Inertial(*(column[which] for column in self))

    def window(self, start: int | None, stop: int | None) -> Inertial:
        """Return the samples with start <= t < stop (µs); None for no bound."""
        return self.take(_during(self.t, start, stop))

    def shifted(self, time: int) -> Inertial:
        """Return the samples with `time` µs subtracted from their times."""
        return self._replace(t=self.t - time)


class Triggers(NamedTuple):
    """External triggers: edges of signals that a camera received, such as the exposures of another camera.

    Args:
        t: Times in µs of the events' clock, int64 [N].
        channel: Number of the input, uint8 [N].
        level: 1 for a rising edge, 0 for a falling one, uint8 [N].
    """

    t: np.ndarray
    channel: np.ndarray
    level: np.ndarray

    @classmethod
    def joined(cls, parts: Sequence[Triggers]) -> Triggers:
        """Concatenate triggers."""
        none = np.empty(0, np.int64), np.empty(0, np.uint8), np.empty(0, np.uint8)
        return cls(*map(np.concatenate, zip(none, *parts, strict=True)))

    def window(self, start: int | None, stop: int | None) -> Triggers:
        """Return the triggers with start <= t < stop (µs); None for no bound."""
        which = _during(self.t, start, stop)
        return Triggers(*(column[which] for column in self))


class Piece(Events):
    """Events together with the other data of a camera, as `nvsdata.write` takes them piece by piece.

    Attributes:
        frames: Frames in the piece's time range.
        inertial: Inertial samples in the piece's time range.
        about: Metadata as in `Recording.about`; in a sequence of pieces, later metadata add to earlier metadata.
    """

    __slots__ = ("about", "frames", "inertial")

    frames: Sequence[Frame]
    inertial: Inertial
    about: Mapping[str, Any]

    @classmethod
    def of_camera(
        cls, events: Events, frames: Sequence[Frame] = (), inertial: Inertial | None = None, about: Any = None
    ) -> Self:
        """Return a piece with these events, frames, inertial samples and metadata; the columns aren't copied."""
        piece = cls.__new__(cls)
        for name in Events.__slots__:
            setattr(piece, name, getattr(events, name))
        piece.frames, piece.inertial, piece.about = frames, inertial or Inertial.empty(), about or {}
        return piece

    @property
    def is_empty(self) -> bool:
        """True if the piece has neither events nor other data."""
        return not (len(self) or len(self.frames) or self.inertial.t.size or self.about)


def without_samples(events: Events) -> Events:
    """Return the events without frames, inertial samples and triggers, for formats that contain only events."""
    return events.of(events.columns) if isinstance(events, Piece) else events


def is_empty(events: Events) -> bool:
    """Return whether there is nothing to write: no events and, in a `Piece`, no other data."""
    return events.is_empty if isinstance(events, Piece) else len(events) == 0


def within(frames: Iterable[Frame], start: int | None, stop: int | None) -> Iterator[Frame]:
    """Yield the frames whose exposure begins at start <= t < stop (µs); None for no bound."""
    return (frame for frame in frames if _least(start) <= frame.exposure_start < _most(stop))


def _during(t: np.ndarray, start: int | None, stop: int | None) -> np.ndarray:
    """Return the mask of the times with start <= t < stop (µs); None for no bound."""
    mask: np.ndarray = (t >= _least(start)) & (t < _most(stop))
    return mask


def _least(time: int | None) -> int:
    return EVER[0] if time is None else time


def _most(time: int | None) -> int:
    return EVER[1] if time is None else time
