"""A film to look at: a video's frames, and beside each the events that were made since the frame before."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from itertools import takewhile

import cv2
import numpy as np

from nvsdata import formats
from nvsdata.data.frame_edges import MICROSECONDS
from nvsdata.plots.events import event_image
from nvsdata.plots.films import save_mp4
from nvsdata.video.folder import Video
from nvsdata.video.frames import USUAL_RATE, TruncatedVideo, frames_of
from nvsdata.video.length import length_of
from nvsdata.video.view import View

LONGEST = 60  # s of the video that are shown
WIDE = 360  # pixels that each half is scaled up to, in whole steps


def save_preview(video: Video, size: tuple[int, int] | None, fps: float | None, view: View) -> None:
    """Write the preview of a video whose recording was made so: its first minute, frame by frame.

    - `size`, `fps`, `view`: as the recording was made

    OSError if the disk is full, or OpenCV can't encode it.
    """
    frames, seconds = length_of(video.path)
    rate = fps or (frames / seconds if seconds else USUAL_RATE)
    save_mp4(_pictures(video, size, fps, view), video.preview, rate)


def _pictures(video: Video, size: tuple[int, int] | None, fps: float | None, view: View) -> Iterator[np.ndarray]:
    """uint8 [H, 2 * W, 3], BGR, for each frame."""
    last = LONGEST * MICROSECONDS
    events = formats.read(video.target, 0, last + 1)
    zoom = max(1, WIDE // events.sensor_size[0])
    before = -1
    frames = frames_of(video.path, fps=fps, size=size, view=view)
    # the recording of a video that is cut off ends there, too, and its line says so
    with suppress(TruncatedVideo):
        for frame in takewhile(lambda one: one.time <= last, frames):
            since = event_image(events.window(before + 1, frame.time + 1), zoom)
            seen = cv2.resize(frame.pixels, since.shape[1::-1], interpolation=cv2.INTER_AREA)
            yield np.hstack([seen if seen.ndim == 3 else cv2.cvtColor(seen, cv2.COLOR_GRAY2BGR), since])
            before = frame.time
