"""One video to convert, and its line of the manifest."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from nvsdata import formats
from nvsdata.batch.folder import Video, sha256
from nvsdata.batch.manifest import file_facts
from nvsdata.batch.run import noted
from nvsdata.common.files import remove_link
from nvsdata.data.events import Events
from nvsdata.data.samples import Piece
from nvsdata.emulation.from_frames import FromFrames
from nvsdata.emulation.protocol import EventEmulator, settings_of
from nvsdata.video.frames import TruncatedVideo, frames_of
from nvsdata.video.length import length_of
from nvsdata.video.view import ALL, View


@dataclass(frozen=True)
class Job:
    """One video to convert."""

    video: Video
    settings: EventEmulator
    size: tuple[int, int] | None
    fps: float | None
    view: View = ALL

    @property
    def name(self) -> str:
        """Name of the video, below the folder of videos."""
        return self.video.name

    def events(self) -> Iterator[Events]:
        """The events of each of the video's frames in turn."""
        ours = isinstance(self.settings, FromFrames)
        if not ours and self.view == ALL:
            # an emulator of the user's may read files its own way
            return self.settings.stream(self.video.path, self.fps, size=self.size)
        color = bool(getattr(self.settings, "hue", False)) or not ours
        frames = frames_of(self.video.path, fps=self.fps, size=self.size, view=self.view, color=color)
        return self.settings.stream(frames)


def convert(job: Job, progress: Callable[[float], None] | None = None) -> dict[str, Any]:
    """Convert one video, and return its line of the manifest. OSError only if the disk or the folder is at fault.

    `progress` is called with the share of the video that is done, if its file says how long it is.
    """
    started = time.monotonic()
    video = job.video
    line: dict[str, Any] = {"video": video.name, "status": "converted"}
    with noted(video, line):
        line |= file_facts(video)
        video.target.parent.mkdir(parents=True, exist_ok=True)
        pieces = _counted(job.events(), line)
        frames = length_of(video.path)[0] if progress else 0
        watched = _watched(pieces, frames, progress) if progress and frames else pieces
        remove_link(video.target)
        formats.write(_told(watched, job.settings), video.target, format=video.format)
        line |= {"recording": video.target.stat().st_size, "recording_sha256": sha256(video.target)}
    return line | {"seconds": round(time.monotonic() - started, 3)}


def _told(pieces: Iterable[Events], settings: EventEmulator) -> Iterator[Events]:
    """The pieces, and at the end an empty one that knows the frames' times and the emulator's settings."""
    times = []
    for piece in pieces:
        times.append(piece.end)
        yield piece
    if times:
        about = {"emulator": settings_of(settings), "frame_times": np.array(times, np.int64)}
        yield Piece.of_camera(Events.empty(piece.sensor_size, piece.end, piece.end), about=about)


def _watched(pieces: Iterable[Events], frames: int, progress: Callable[[float], None]) -> Iterator[Events]:
    """The pieces; `progress` is told with each."""
    for number, piece in enumerate(pieces):
        yield piece
        progress(number / frames)


def _counted(pieces: Iterable[Events], line: dict[str, Any]) -> Iterator[Events]:
    """The pieces, counted in `line`; a video that is cut off ends without an error, and `line` says so."""
    line |= {"frames": 0, "events": 0}
    try:
        for piece in pieces:
            line["frames"] += 1
            line["events"] += len(piece)
            line["sensor_size"] = piece.sensor_size
            line["duration"] = piece.end
            if "imperfections" in (about := getattr(piece, "about", {})):
                line["imperfections"] = about["imperfections"]
            yield piece
    except TruncatedVideo as error:
        line |= {"status": "truncated", "reason": str(error)}
