"""An emulation that goes on from call to call."""

from __future__ import annotations

import pickle
from collections.abc import Iterable, Iterator
from itertools import chain, count
from typing import cast

from nvsdata.data.events import Events, concatenate_events
from nvsdata.data.frame_edges import MICROSECONDS
from nvsdata.emulation.from_frames import FromFrames
from nvsdata.emulation.imperfections import Flawed, Imperfections
from nvsdata.emulation.run import Run
from nvsdata.video.frames import USUAL_RATE, Frame, Video, frames_of
from nvsdata.video.upsample import upsampled


class Ongoing:
    """An emulation whose state carries over calls: the events of a video in parts are those of all of it at once.

    - `settings`: the emulator, such as `PIX2NVS()`

    It can be pickled between calls, so that another process goes on.
    """

    def __init__(self, settings: FromFrames) -> None:
        self.settings = settings
        self._run: Run | None = None
        self._flaws: Imperfections | None = None
        self._last: Frame | None = None
        self._gap = round(MICROSECONDS / USUAL_RATE)
        self._count = 0

    def feed(
        self,
        frames: Video,
        fps: float | None = None,
        *,
        times: Iterable[int] | None = None,
        size: tuple[int, int] | None = None,
    ) -> Events:
        """The events of further frames, since the last one of the call before; none for the very first frame.

        - `frames`, `size`: as `PIX2NVS.stream` takes them
        - `fps`: frame n of all calls is at n / fps s (default: times of their own go on a frame's time after the last)
        - `times`: in place of `fps`, the time of each frame in µs, rising over all calls

        Raises the errors of `PIX2NVS.stream`, and ValueError if the first call has no frames. After an error the state
        is that before the call.
        """
        color = bool(getattr(self.settings, "hue", False))
        if fps is None and times is None:
            found = self._later(frames_of(frames, size=size, color=color))
        else:
            if fps is not None and times is None:
                times, fps = _regular(self._count, fps), None
            found = frames_of(frames, fps=fps, times=times, size=size, color=color)
        before = () if self._last is None else (self._last,)
        steps = upsampled(chain(before, found), getattr(self.settings, "upsample", "none"))
        if self._last is not None:
            next(steps)
        before_all = pickle.dumps((self._run, self._flaws))
        kept = self._last, self._gap, self._count
        try:
            parts = [self._step(frame) for frame in steps]
        except BaseException:
            self._run, self._flaws = pickle.loads(before_all)
            self._last, self._gap, self._count = kept
            raise
        if self._run is None or self._last is None:
            raise ValueError("a video of no frames")
        return (
            concatenate_events(parts)
            if parts
            else Events.empty(self._run.sensor_size, self._last.time, self._last.time)
        )

    def _step(self, frame: Frame) -> Events:
        if self._run is None:
            self._run = self.settings.begin(frame)
            spikes = self._run.none(frame.time)
            self._flaws = Imperfections.of(cast(Flawed, self.settings), spikes.sensor_size)
            events = spikes.events()
        else:
            spikes = self._run.step(frame)
            events = spikes.events()
            if self._flaws is not None:
                events = self._flaws.apply(events, spikes.before, spikes.now, spikes.light)
        if frame.whole:
            self._gap = self._gap if self._last is None else frame.time - self._last.time
            self._last, self._count = frame, self._count + 1
        return events

    def _later(self, frames: Iterator[Frame]) -> Iterator[Frame]:
        """The frames at times that go on after the last one."""
        offset: int | None = 0 if self._last is None else None
        for frame in frames:
            if offset is None:
                assert self._last is not None
                offset = self._last.time + self._gap - frame.time
            yield frame._replace(time=frame.time + offset)


def _regular(first: int, fps: float) -> Iterator[int]:
    """The times of frame number `first` and those after it."""
    return (round(n * MICROSECONDS / fps) for n in count(first))
