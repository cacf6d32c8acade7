"""Conversion of one video, and its line of the manifest."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from nvsdata import formats
from nvsdata.batch.folder import Video
from nvsdata.batch.manifest import file_facts, sha256
from nvsdata.batch.run import catch_failure
from nvsdata.common.files import remove_link
from nvsdata.data.events import Events
from nvsdata.data.samples import Piece
from nvsdata.emulation.frame_emulator import FrameEmulator, emulate_frames
from nvsdata.emulation.protocol import EventEmulator, describe_settings
from nvsdata.video.decoder import length_of
from nvsdata.video.frames import TruncatedVideo, frames_of
from nvsdata.video.view import WHOLE_VIDEO, VideoView


@dataclass(frozen=True)
class Job:
    """A video to convert.

    Args:
        video: The video and its recording.
        settings: The emulator.
        size: (width, height) in pixels that frames are scaled to; None leaves them unchanged.
        fps: Frames per second, or None for the video's own times.
        view: Part of the video, and how its frames are fitted to `size`.
    """

    video: Video
    settings: EventEmulator
    size: tuple[int, int] | None
    fps: float | None
    view: VideoView = WHOLE_VIDEO

    @property
    def name(self) -> str:
        """Name of the video, relative to the folder of videos."""
        return self.video.name

    def events(self) -> Iterator[Events]:
        """Yield the events of each frame of the video."""
        path, settings = self.video.path, self.settings
        if isinstance(settings, FrameEmulator):
            frames = frames_of(path, fps=self.fps, size=self.size, view=self.view, color=settings.hue)
            return emulate_frames(settings, frames)
        if self.view == WHOLE_VIDEO:
            # a user's emulator may read files in its own way
            return settings.stream(path, self.fps, size=self.size)
        return settings.stream(frames_of(path, fps=self.fps, size=self.size, view=self.view))


def convert(job: Job, progress: Callable[[float], None] | None = None) -> dict[str, Any]:
    """Convert a video, and return its line of the manifest.

    Args:
        job: The video.
        progress: Called with the fraction of the video that is done, if the file states its length.

    Raises:
        OSError: The recording can't be written. A video that can't be read raises nothing; its line has the reason.
    """
    started = time.monotonic()
    video = job.video
    line: dict[str, Any] = {"video": video.name, "status": "converted"}
    with catch_failure(video, line):
        line |= file_facts(video)
        video.target.parent.mkdir(parents=True, exist_ok=True)
        pieces = _pieces(job, line, progress)
        remove_link(video.target)
        formats.write(pieces, video.target, format=video.format)
        line |= {"recording": video.target.stat().st_size, "recording_sha256": sha256(video.target)}
    return line | {"seconds": round(time.monotonic() - started, 3)}


def _pieces(job: Job, line: dict[str, Any], progress: Callable[[float], None] | None) -> Iterator[Events]:
    """Yield the video's events, then an empty piece with the times of the frames and the settings of the emulator.

    The numbers of frames and events are written to `line`, the video's line of the manifest. A truncated video doesn't
    raise an error; its line gets the status "truncated".
    """
    line |= {"frames": 0, "events": 0}
    promised = length_of(job.video.path)[0] if progress else 0
    times = []
    try:
        for piece in job.events():
            times.append(piece.end)
            line |= {"frames": len(times), "events": line["events"] + len(piece)}
            line |= {"sensor_size": piece.sensor_size, "duration": piece.end}
            if "imperfections" in (about := getattr(piece, "about", {})):
                line["imperfections"] = about["imperfections"]
            yield piece
            if progress and promised:
                progress((len(times) - 1) / promised)
    except TruncatedVideo as error:
        line |= {"status": "truncated", "reason": str(error)}
    if times:
        about = {"emulator": describe_settings(job.settings), "frame_times": np.array(times, np.int64)}
        yield Piece.of_camera(Events.empty(piece.sensor_size, piece.end, piece.end), about=about)
