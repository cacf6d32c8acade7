"""One video to convert, and its line of the manifest."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2

from nvsdata import formats
from nvsdata.data.events import Events
from nvsdata.emulation.protocol import EventEmulator
from nvsdata.video.folder import fatal, sha256
from nvsdata.video.frames import TruncatedVideo


@dataclass(frozen=True)
class Job:
    """One video to convert."""

    name: str  # below the folder of videos, with slashes
    video: Path
    target: Path
    settings: EventEmulator
    size: tuple[int, int] | None
    fps: float | None


def convert(job: Job) -> dict[str, Any]:
    """Convert one video, and return its line of the manifest. OSError only if the disk or the folder is at fault."""
    started = time.monotonic()
    line: dict[str, Any] = {"video": job.name, "status": "converted"}
    try:
        stat = job.video.stat()
        line |= {"bytes": stat.st_size, "sha256": sha256(job.video)}
        job.target.parent.mkdir(parents=True, exist_ok=True)
        pieces = job.settings.stream(job.video, job.fps, size=job.size)
        formats.write(_counted(pieces, line), job.target)
        line["recording"] = job.target.stat().st_size
    except (ValueError, OSError, cv2.error, MemoryError) as error:
        if isinstance(error, OSError) and fatal(error, job.video):
            raise
        line |= {"status": "failed", "reason": str(error)}
    return line | {"seconds": round(time.monotonic() - started, 3)}


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
