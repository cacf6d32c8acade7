"""Emulation frame by frame, for all emulators of this package, and of videos that arrive in parts."""

from __future__ import annotations

import pickle
from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator
from itertools import chain

from nvsdata.common.prefetch import prefetch
from nvsdata.data.events import Events, concatenate_events
from nvsdata.data.frame_edges import MICROSECONDS
from nvsdata.data.samples import Piece
from nvsdata.emulation.state import EmulatorState
from nvsdata.video.decoder import USUAL_RATE
from nvsdata.video.frames import VideoFrame, VideoInput, frames_of, regular_times
from nvsdata.video.upsample import Upsample, upsample_frames

WORTH = 0.3e-3  # s of emulation per frame from which emulation in a separate thread is faster


class FrameEmulator(ABC):
    """Base class of emulators that process a video frame by frame; a subclass adds the settings."""

    hue: bool = False
    upsample: Upsample | int = "none"

    def emulate(
        self,
        video: VideoInput,
        *,
        fps: float | None = None,
        times: Iterable[int] | None = None,
        size: tuple[int, int] | None = None,
    ) -> Events:
        """Return all events of a video; parameters and errors are those of `stream`.

        Args:
            video: A video file, a camera's number, a folder of images, a recording with frames, or arrays.
            fps: Frames per second, in place of the video's own times.
            times: Times of the frames in µs, rising, in place of `fps`.
            size: (width, height) in pixels that frames are scaled to (default: unchanged).

        Returns:
            The events. Their times (µs) are relative to the first frame, or those of the video's clock or of `times`.

        Example:
            >>> import numpy as np, nvsdata
            >>> frames = [np.full((4, 6), gray, np.uint8) for gray in (100, 200)]
            >>> len(nvsdata.PIX2NVS().emulate(frames, fps=25))
            72
        """
        return concatenate_events(list(self.stream(video, fps, times=times, size=size)))

    def stream(
        self,
        frames: VideoInput,
        fps: float | None = None,
        *,
        times: Iterable[int] | None = None,
        size: tuple[int, int] | None = None,
    ) -> Iterator[Events]:
        """Yield the events between each frame and the one before, in constant memory.

        The first piece belongs to the first frame and is empty. With imperfections, pieces are `Piece`s whose `about`
        counts the events that each imperfection added or removed since the first frame; HDF5 recordings store the last
        counts.

        Args:
            frames: A video file (its luminance is the luma that the codec stores, if that has 8 bits), a camera's
                number, a folder of images with a list of times, a recording that has frames (`nvsdata.open`), or an
                iterable of arrays or image files. Arrays are gray [H, W], RGB [H, W, 3] or RGBA [H, W, 4] of uint8 or
                bool, or of uint16 or floats in [0, 1], which are scaled to 255.
            fps: Frames per second: frame n is at n / fps s (default: the file's own times, or the clock of a camera,
                recording or list; 30 for arrays and images).
            times: Times of the frames in µs, rising, in place of `fps`.
            size: (width, height) in pixels that frames are scaled to (default: unchanged).

        Returns:
            An iterator over `Events`, one per frame.

        Raises:
            FileNotFoundError: There is no such video.
            FormatError: OpenCV can't decode the video.
            ValueError: There are no frames, their size or type changes, times don't rise, or the settings need larger
                frames.

        Example:
            >>> import numpy as np, nvsdata
            >>> frames = [np.full((4, 6), gray, np.uint8) for gray in (100, 200, 200)]
            >>> [len(events) for events in nvsdata.PIX2NVS(exp=False).stream(frames, fps=25)]
            [0, 72, 0]
        """
        return emulate_frames(self, frames_of(frames, fps=fps, times=times, size=size, color=self.hue))

    @abstractmethod
    def begin(self, first: VideoFrame) -> EmulatorState:
        """Return the state of an emulation that begins with a frame."""


def emulate_frames(emulator: FrameEmulator, frames: Iterator[VideoFrame]) -> Iterator[Events]:
    """Yield the events of each frame, as `FrameEmulator.stream` does."""
    more = upsample_frames(frames, emulator.upsample)
    first = next(more, None)
    if first is None:
        raise ValueError("the video has no frames")
    state, parts = emulator.begin(first), []
    steps = prefetch(map(state.step, more), WORTH)
    for spikes in chain((state.none(first.time),), steps):
        parts.append(state.events(spikes))
        if spikes.whole:
            found, parts = parts[0] if len(parts) == 1 else concatenate_events(parts), []
            flaws = state.imperfections
            yield found if flaws is None else Piece.of_camera(found, about={"imperfections": dict(flaws.counts)})


class StatefulEmulator:
    """Stateful emulator: it returns the same events for a video in parts as for all of it at once.

    It can be pickled between calls, so that another process continues.

    Args:
        settings: The emulator, such as `PIX2NVS()`.

    Example:
        >>> import numpy as np, nvsdata
        >>> emulator = StatefulEmulator(nvsdata.PIX2NVS())
        >>> frames = [np.full((4, 6), gray, np.uint8) for gray in (100, 200)]
        >>> [len(emulator.feed([frame], fps=25)) for frame in frames]
        [0, 72]
    """

    def __init__(self, settings: FrameEmulator) -> None:
        self.settings = settings
        self._state: EmulatorState | None = None
        self._last: VideoFrame | None = None
        self._gap = round(MICROSECONDS / USUAL_RATE)
        self._count = 0

    def feed(
        self,
        frames: VideoInput,
        fps: float | None = None,
        *,
        times: Iterable[int] | None = None,
        size: tuple[int, int] | None = None,
    ) -> Events:
        """Return the events of further frames, starting at the last frame of the previous call.

        After an error, the state is that before the call.

        Args:
            frames: Frames, as `PIX2NVS.stream` takes them.
            fps: Frames per second: frame n of all calls is at n / fps s (default: the frames' own times, shifted so
                that the first frame is one frame interval after the last frame of the previous call).
            times: Times of the frames in µs, rising over all calls, in place of `fps`.
            size: (width, height) in pixels that frames are scaled to (default: unchanged).

        Returns:
            The events; none for the very first frame.

        Raises:
            ValueError: The first call has no frames. Other errors are those of `PIX2NVS.stream`.
        """
        own_times = fps is None and times is None
        if fps is not None and times is None:
            times, fps = regular_times(fps, self._count), None
        found = frames_of(frames, fps=fps, times=times, size=size, color=self.settings.hue)
        if own_times:
            found = self._later(found)
        before = () if self._last is None else (self._last,)
        more = upsample_frames(chain(before, found), self.settings.upsample)
        if self._last is not None:
            next(more)
        saved, kept = pickle.dumps(self._state), (self._last, self._gap, self._count)
        try:
            parts = [self._step(frame) for frame in more]
        except BaseException:
            self._state = pickle.loads(saved)
            self._last, self._gap, self._count = kept
            raise
        if self._state is None or self._last is None:
            raise ValueError("the video has no frames")
        return (
            concatenate_events(parts)
            if parts
            else Events.empty(self._state.sensor_size, self._last.time, self._last.time)
        )

    def _step(self, frame: VideoFrame) -> Events:
        """Return the events of the next frame."""
        if self._state is None:
            self._state = self.settings.begin(frame)
            spikes = self._state.none(frame.time)
        else:
            spikes = self._state.step(frame)
        events = self._state.events(spikes)
        if frame.whole:
            self._gap = self._gap if self._last is None else frame.time - self._last.time
            self._last, self._count = frame, self._count + 1
        return events

    def _later(self, frames: Iterator[VideoFrame]) -> Iterator[VideoFrame]:
        """Yield the frames, with times that continue after the last frame."""
        offset: int | None = 0 if self._last is None else None
        for frame in frames:
            if offset is None:
                assert self._last is not None
                offset = self._last.time + self._gap - frame.time
            yield frame._replace(time=frame.time + offset)
