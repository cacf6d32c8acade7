"""Objective of tuning: distances of emulated events to a real recording of the same video."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import cached_property, partial
from itertools import islice, takewhile
from pathlib import Path

import numpy as np

from nvsdata.data.events import Events
from nvsdata.data.recording import Recording
from nvsdata.emulation.dvs import DVS
from nvsdata.emulation.fitting import Fit, check_common, fit
from nvsdata.emulation.protocol import EventEmulator
from nvsdata.emulation.tuning.search import Measured
from nvsdata.metrics.distance import compare, event_counts
from nvsdata.video.frames import VideoFrame, VideoInput, frames_of


class TuningPair:
    """Real recording, and the video that it shows, scaled to the sensor; calling the pair measures an emulator.

    Events are compared at the video's frame rate. The frames are kept in memory.

    Args:
        real: Events of a camera that recorded the video.
        video: The video, as `PIX2NVS.stream` takes it.
        fps: Frames per second, in place of the video's own times.
        seconds: Length in s of the part that is compared, from the start (default: all).
        offset: Time in µs that is added to the recording's times, which are relative to its start.
        one_way: Measure distances from emulated spikes to real ones only, as in the thesis (default: in both
            directions, and the differences of the numbers of events). One-way distances favor emulators with too few
            events, because missing events cost nothing.

    Raises:
        ValueError: Fewer than two frames are compared, or the times of frames and events don't overlap.

    Example:
        >>> from nvsdata import PIX2NVS
        >>> frames = [np.roll(np.tri(24, 32) * 200, n, 1).astype(np.uint8) for n in range(4)]
        >>> pair = TuningPair(PIX2NVS().emulate(frames, fps=30), frames)
        >>> pair(PIX2NVS()).distances[0]
        0.0
    """

    def __init__(
        self,
        real: Events | Recording,
        video: VideoInput,
        *,
        fps: float | None = None,
        seconds: float | None = None,
        offset: int = 0,
        one_way: bool = False,
    ) -> None:
        self._first: int | None = None
        end = np.inf if seconds is None else seconds * 1e6
        size = real.sensor_size

        def load(color: bool) -> Iterator[VideoFrame]:
            found = frames_of(video, fps=fps, size=size, color=color)
            return takewhile(lambda f: f.time <= end, map(self._from_the_first, found))

        frames = list(load(color=False))
        # only hue, which few settings use, needs the colors of a file; arrays have them already
        of_file = isinstance(video, str | os.PathLike)
        if len(frames) < 2:
            shown = "the video" if isinstance(video, Iterable) and not of_file else video
            raise ValueError(f"{shown}: {len(frames)} frames in the time that is compared, at least 2 are needed")
        # a video that states times has the clock of the recording
        own = isinstance(video, Recording) or (isinstance(video, str | os.PathLike) and Path(video).is_dir())
        origin = (self._first or 0) if own else self._first or real.start
        check_common((origin, origin + frames[-1].time), real)
        events = _cut(real, origin, origin + max(frames[-1].time - offset, 1))
        self._set(frames, partial(load, True) if of_file else lambda: frames, events, offset, one_way)

    def _set(
        self,
        frames: list[VideoFrame],
        colored: Callable[[], Iterable[VideoFrame]],
        real: Events,
        offset: int,
        one_way: bool,
    ) -> None:
        self.frames, self._load_colored, self.real, self.offset, self.one_way = frames, colored, real, offset, one_way
        self.fps = (len(frames) - 1) * 1e6 / frames[-1].time

    def split(self, share: float) -> tuple[TuningPair, TuningPair]:
        """Split the pair into two by time; the second part has the last `share` (fraction from 0 to 1) of the frames.

        Raises:
            ValueError: Either part has fewer than two frames.
        """
        last = len(self.frames) - 1 - math.ceil(share * (len(self.frames) - 1))
        if not 0 < last < len(self.frames) - 1:
            raise ValueError(
                f"{len(self.frames)} frames can't be split with {share:.0%} in the second part: choose another fraction"
            )
        return self._part(0, last), self._part(last, len(self.frames) - 1)

    def _part(self, first: int, last: int) -> TuningPair:
        """Return a pair of the frames from number `first` to `last`, and the events between them."""
        begin, end = self.frames[first].time, self.frames[last].time
        # the events before a video belong to its first part
        early = begin - self.offset if first else 0
        events = _cut(self.real, self.real.start + early, self.real.start + max(end - self.offset, early + 1))
        part = object.__new__(TuningPair)

        def cut(frames: Iterable[VideoFrame]) -> list[VideoFrame]:
            return [frame._replace(time=frame.time - begin) for frame in islice(frames, first, last + 1)]

        part._set(cut(self.frames), lambda: cut(self._colored), events, 0 if first else self.offset, self.one_way)
        return part

    def fitted(self, base: DVS) -> Fit:
        """Return the result of `emulation.fit` for the pair; its errors are those of `fit`."""
        columns, end = self.real.columns, self.real.end - self.real.start + self.offset
        t = columns.t - self.real.start + self.offset
        return fit(self.frames, Events.trusted(columns._replace(t=t), self.real.sensor_size, 0, max(end, 1)), base=base)

    def _from_the_first(self, frame: VideoFrame) -> VideoFrame:
        """Return the frame with its time relative to the first one."""
        self._first = frame.time if self._first is None else self._first
        return frame._replace(time=frame.time - self._first)

    def emulate(self, settings: EventEmulator) -> Events:
        """Return the events of the video by an emulator."""
        return settings.emulate(self._colored if getattr(settings, "hue", False) else self.frames)

    @cached_property
    def _colored(self) -> list[VideoFrame]:
        return list(self._load_colored())

    @cached_property
    def colored(self) -> bool:
        """True if the video has colors, which hue needs."""
        return next(iter(self._load_colored())).pixels.ndim == 3

    def __call__(self, settings: EventEmulator) -> Measured:
        """Return the distances of an emulator (`Comparison.values` or `values_both_ways`) and its event counts.

        Distances are NaN if more than half of the frames with real spikes have no emulated spike. Otherwise emulators
        that hardly ever fire could win, because distances leave out such frames.
        """
        found = compare(self.emulate(settings), self.real, self.fps, offset=self.offset)
        real = found.emd.frames.size - found.emd.empty_real
        distances: tuple[float, ...] = found.values if self.one_way else found.values_both_ways
        if not found.emd.used or 2 * found.emd.used < real:
            distances = (math.nan,) * len(distances)
        return Measured(distances, found.emulated_events)

    @property
    def real_events(self) -> tuple[int, int]:
        """The camera's numbers of OFF and of ON events."""
        # an offset below 0 excludes events before the video
        return event_counts(self.real, max(-self.offset, 0), self.real.end - self.real.start)


def _cut(real: Events | Recording, start: int, stop: int) -> Events:
    """Return the events from `start` to `stop` (µs), as a recording that begins at `start`."""
    found = real.read(start, stop) if isinstance(real, Recording) else real.window(start, stop)
    return Events.trusted(found.columns, found.sensor_size, start, stop - 1)


def measured_on(pairs: Sequence[TuningPair], settings: EventEmulator) -> Measured:
    """Return the mean distances over several pairs, and the sums of their event counts."""
    each = [pair(settings) for pair in pairs]
    off, on = (sum(one.events[p] for one in each) for p in (0, 1))
    return Measured(tuple(np.mean([one.distances for one in each], axis=0).tolist()), (off, on))
