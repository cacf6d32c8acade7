"""Recordings in pieces: events together with frames and inertial samples."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import suppress
from datetime import datetime, timedelta
from itertools import pairwise
from typing import Any

import numpy as np

from nvsdata.data.events import EVER, Columns, Events
from nvsdata.data.recording import Recording
from nvsdata.data.samples import Frame, Inertial, Piece


class _OtherData:
    """Frames and inertial samples of a recording, read once, in order of time."""

    def __init__(self, recording: Recording, start: int | None = None, stop: int | None = None) -> None:
        inertial = recording.inertial(start, stop)
        self._inertial = inertial.take(np.argsort(inertial.t, kind="stable"))
        self._frames = recording.frames(start, stop)
        self._next = next(self._frames, None)

    def first(self) -> list[int]:
        """Return the times in µs of the next inertial sample and the next frame, if there are any."""
        times = self._inertial.t[:1].tolist()
        return times if self._next is None else [*times, self._next.exposure_start]

    def until(self, last: int) -> tuple[list[Frame], Inertial]:
        """Return the frames and inertial samples not returned before, up to and including the time `last` (µs)."""
        frames = []
        while self._next is not None and self._next.exposure_start <= last:
            frames.append(self._next)
            self._next = next(self._frames, None)
        count = int(self._inertial.t.searchsorted(last, "right"))
        samples, self._inertial = self._inertial.take(slice(count)), self._inertial.take(slice(count, None))
        return frames, samples


def in_pieces(recording: Recording, every: int = 1_000_000) -> Iterator[Piece]:
    """Yield a recording in pieces of `every` µs with frames and inertial samples, then an empty piece with `about`.

    All events are decoded first, so that damage is reported before the first piece. Times without any data are skipped.
    """
    events, other, done = recording.read(), _OtherData(recording), 0
    while times := [*events.t[done : done + 1].tolist(), *other.first()]:
        last = min(min(times) + every - 1, EVER[1])
        count = int(events.t.searchsorted(last, "right"))
        end = max(events.start, min(last, events.end))
        piece = Events.trusted(events.columns.take(slice(done, count)), events.sensor_size, events.start, end)
        yield Piece.of_camera(piece, *other.until(last))
        done = count
    yield Piece.of_camera(Events.empty(events.sensor_size, events.start, events.end), about=recording.about)


def in_windows(recording: Recording, count: int) -> Iterator[Events]:
    """Yield a recording in `count` windows of equal duration; only one window at a time is in memory.

    Damage is reported when the window that contains it is read.
    """
    first, last = recording.span
    edges = [first + (last + 1 - first) * n // count for n in range(count + 1)]
    for n, (start, stop) in enumerate(pairwise(edges)):
        events = recording.read(start, stop)
        begin = min(recording.start, start) if n == 0 else start
        end = max(recording.end, stop - 1) if n == count - 1 else max(stop - 1, begin)
        yield Events.trusted(events.columns, events.sensor_size, begin, end)


def cut_pieces(recording: Recording, start: int, stop: int, every: int = 1_000_000) -> Iterator[Events]:
    """Yield a recording from `start` to `stop` (µs) in pieces of `every` µs, with times counted from `start`.

    A frame belongs to the piece in which its exposure begins. In `about`, `started` becomes the wall-clock time of
    `start`.
    """
    about = about_from(recording.about, start)
    other = _OtherData(recording, start, stop) if recording.holds_samples else None
    for begin in range(start, stop, every):
        end = min(begin + every, stop)
        events = recording.read(begin, end)
        columns = Columns(events.t - start, events.x, events.y, events.p)
        shifted = Events.trusted(columns, events.sensor_size, begin - start, events.end - start)
        if other is not None:
            frames, inertial = other.until(end - 1)
            shifted = Piece.of_camera(shifted, [f.shifted(start) for f in frames], inertial.shifted(start), about)
            about = {}
        yield shifted


def about_from(about: Mapping[str, Any], time: int) -> dict[str, Any]:
    """Shift the times in the metadata `Recording.about`, for a part whose times are relative to `time` µs."""
    moved = dict(about)
    if "frame_times" in moved:
        moved["frame_times"] = moved["frame_times"] - time
    with suppress(KeyError, TypeError, ValueError):
        began = datetime.fromisoformat(moved["started"])
        moved["started"] = (began + timedelta(microseconds=time)).isoformat(timespec="microseconds")
    return moved
