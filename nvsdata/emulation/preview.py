"""Preview films: the frames of a video, each next to the events since the previous frame."""

from __future__ import annotations

import errno
from collections.abc import Iterator
from contextlib import suppress
from itertools import takewhile
from pathlib import Path

import cv2
import numpy as np

from nvsdata import formats
from nvsdata.data.frame_edges import MICROSECONDS
from nvsdata.emulation.job import Job
from nvsdata.plots.drawing import event_image
from nvsdata.plots.films import save_mp4
from nvsdata.video.decoder import USUAL_RATE, length_of
from nvsdata.video.frames import TruncatedVideo, frames_of

FOLDER = ".previews"  # in the folder of recordings; hidden, so that its films are taken for neither videos nor classes
LONGEST = 60  # s of the video
WIDE = 360  # pixels; narrower halves of the film are enlarged to at most this width, by a whole number
FASTEST = 240.0  # frames per second


def preview_of(recording: Path, out: Path) -> Path:
    """Return the path of the preview film of a recording in `out`."""
    name = recording.relative_to(out)
    return out / FOLDER / name.with_name(f"{name.name}.mp4")


def save_preview(job: Job, film: Path) -> str:
    """Write the preview film of a video's first minute; return the reason of a failure, "" for success.

    Raises:
        OSError: The disk is full or read-only.
    """
    try:
        frames, seconds = length_of(job.video.path)
        rate = job.fps or (frames / seconds if seconds else USUAL_RATE)
        film.parent.mkdir(parents=True, exist_ok=True)
        # the time unit of MPEG-4 is at least 1/65,535 s
        save_mp4(_images(job), film, round(min(max(rate, 1.0), FASTEST), 2))
    except (OSError, ValueError, cv2.error, MemoryError) as error:
        if isinstance(error, OSError) and error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EROFS):
            raise
        return str(error)
    return ""


def _images(job: Job) -> Iterator[np.ndarray]:
    """Yield the film's images, uint8 [H, 2 W, 3] in blue, green, red."""
    last = LONGEST * MICROSECONDS
    events = formats.read(job.video.target, 0, last + 1)
    zoom = max(1, WIDE // events.sensor_size[0])
    before = -1
    frames = frames_of(job.video.path, fps=job.fps, size=job.size, view=job.view)
    # the recording of a truncated video ends at the same frame, and its manifest has the reason
    with suppress(TruncatedVideo):
        for frame in takewhile(lambda one: one.time <= last, frames):
            since = event_image(events.window(before + 1, frame.time + 1), zoom)
            seen = cv2.resize(frame.pixels, since.shape[1::-1], interpolation=cv2.INTER_AREA)
            yield np.hstack([seen if seen.ndim == 3 else cv2.cvtColor(seen, cv2.COLOR_GRAY2BGR), since])
            before = frame.time
