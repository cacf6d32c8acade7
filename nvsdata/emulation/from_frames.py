"""Events from videos, frame by frame: what all emulators of this package share."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator
from typing import cast

from nvsdata.common.prefetch import prefetch
from nvsdata.data.events import Events, concatenate_events
from nvsdata.data.samples import Piece
from nvsdata.emulation.imperfections import Flawed, Imperfections
from nvsdata.emulation.run import Run, Spikes
from nvsdata.video.frames import Frame, Video, frames_of
from nvsdata.video.upsample import upsampled

WORTH = 0.3e-3  # s of emulation per frame from which a thread of its own pays


class FromFrames(ABC):
    """An emulator that goes from frame to frame; its settings, and those of `Flawed`, are a subclass's."""

    def emulate(
        self,
        video: Video,
        *,
        fps: float | None = None,
        times: Iterable[int] | None = None,
        size: tuple[int, int] | None = None,
    ) -> Events:
        """All events of a video; times count from its first frame, or are those of its own clock or `times`.

        Parameters and errors are those of `stream`.
        """
        parts = list(self.stream(video, fps, times=times, size=size))
        return concatenate_events(parts)

    def stream(
        self,
        frames: Video,
        fps: float | None = None,
        *,
        times: Iterable[int] | None = None,
        size: tuple[int, int] | None = None,
    ) -> Iterator[Events]:
        """Events of each frame in turn, those of F_n since F_n-1, in constant memory.

        The first piece stands for F_0 and is empty. With imperfections, pieces are `Piece` whose `about` counts, from
        the first frame on, what they added and left out; HDF5 recordings keep the last counts.

        - `frames`: a video file (luminance is the luma that its codec stores, where it is of 8 bits), a
          camera's number, a folder of images with a list of times, a recording that holds frames (`nvsdata.open`), or
          an iterable of arrays or image files. Arrays are [H, W] gray, [H, W, 3] RGB or
          [H, W, 4] RGBA; uint8 or bool, or uint16 and floats in [0, 1], which are scaled to 255
        - `fps`: frame n is at n / fps s, whatever the file says (default: the file's own times, the clock of a camera,
          recording or list, 30 per second for arrays and images)
        - `times`: in place of `fps`, the time of each frame in µs, rising
        - `size`: (width, height) in pixels that frames are scaled to (default: as they are)

        Raises FileNotFoundError, FormatError for a file that holds no video, and ValueError for frames that change
        their size or type, times that don't rise, no frames, and settings that the frame is too small for.
        """
        found = frames_of(frames, fps=fps, times=times, size=size, color=getattr(self, "hue", False))
        more = upsampled(found, getattr(self, "upsample", "none"))
        return self._events(prefetch(self._spikes(more), WORTH))

    @abstractmethod
    def begin(self, first: Frame) -> Run:
        """A run that begins with a frame."""

    def _spikes(self, frames: Iterator[Frame]) -> Iterator[Spikes]:
        first = next(frames, None)
        if first is None:
            raise ValueError("a video of no frames")
        run = self.begin(first)
        yield run.none(first.time)
        yield from map(run.step, frames)

    def _events(self, pieces: Iterator[Spikes]) -> Iterator[Events]:
        flaws: Imperfections | None = None
        parts: list[Events] = []
        for spikes in pieces:
            events = spikes.events()
            flaws = flaws or Imperfections.of(cast(Flawed, self), events.sensor_size)
            if flaws and spikes.now != spikes.before:
                events = flaws.apply(events, spikes.before, spikes.now, spikes.light)
            parts.append(events)
            if spikes.whole:
                found, parts = parts[0] if len(parts) == 1 else concatenate_events(parts), []
                yield found if flaws is None else Piece.of_camera(found, about={"imperfections": dict(flaws.counts)})
