"""One video to convert, and its line of the manifest."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Any

from nvsdata import formats
from nvsdata.data.events import Events
from nvsdata.emulation.protocol import EventEmulator
from nvsdata.video.folder import Video
from nvsdata.video.frames import TruncatedVideo
from nvsdata.video.length import length_of
from nvsdata.video.manifest import file_facts, noted


@dataclass(frozen=True)
class Job:
    """One video to convert."""

    video: Video
    settings: EventEmulator
    size: tuple[int, int] | None
    fps: float | None


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
        pieces = _counted(job.settings.stream(video.path, job.fps, size=job.size), line)
        frames = length_of(video.path)[0] if progress else 0
        formats.write(_watched(pieces, frames, progress) if progress and frames else pieces, video.target)
        line["recording"] = video.target.stat().st_size
    return line | {"seconds": round(time.monotonic() - started, 3)}


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
            yield piece
    except TruncatedVideo as error:
        line |= {"status": "truncated", "reason": str(error)}
