"""Films to look at: a video's frames, and beside each the events that were made since the frame before."""

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
from nvsdata.video.frames import USUAL_RATE, TruncatedVideo, frames_of
from nvsdata.video.length import length_of

FOLDER = ".previews"  # below that of the recordings; hidden, so that its films are taken for neither videos nor classes
LONGEST = 60  # s of the video that are shown
WIDE = 360  # pixels that each half is scaled up to, in whole steps
FASTEST = 240.0  # pictures per second


def preview_of(recording: Path, out: Path) -> Path:
    """Where the film of a recording below `out` goes."""
    name = recording.relative_to(out)
    return out / FOLDER / name.with_name(f"{name.name}.mp4")


def save_preview(job: Job, film: Path) -> str:
    """Write the film of a recording that was made, the first minute of its video; returns why that isn't possible.

    OSError if the disk is full.
    """
    try:
        frames, seconds = length_of(job.video.path)
        rate = job.fps or (frames / seconds if seconds else USUAL_RATE)
        film.parent.mkdir(parents=True, exist_ok=True)
        # MPEG-4 counts in parts of a second, of which it has 65,535 at most
        save_mp4(_pictures(job), film, round(min(max(rate, 1.0), FASTEST), 2))
    except (OSError, ValueError, cv2.error, MemoryError) as error:
        if isinstance(error, OSError) and error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EROFS):
            raise
        return str(error)
    return ""


def _pictures(job: Job) -> Iterator[np.ndarray]:
    """uint8 [H, 2 * W, 3], BGR, for each frame."""
    last = LONGEST * MICROSECONDS
    events = formats.read(job.video.target, 0, last + 1)
    zoom = max(1, WIDE // events.sensor_size[0])
    before = -1
    frames = frames_of(job.video.path, fps=job.fps, size=job.size, view=job.view)
    # the recording of a video that is cut off ends there, too, and its line says so
    with suppress(TruncatedVideo):
        for frame in takewhile(lambda one: one.time <= last, frames):
            since = event_image(events.window(before + 1, frame.time + 1), zoom)
            seen = cv2.resize(frame.pixels, since.shape[1::-1], interpolation=cv2.INTER_AREA)
            yield np.hstack([seen if seen.ndim == 3 else cv2.cvtColor(seen, cv2.COLOR_GRAY2BGR), since])
            before = frame.time
