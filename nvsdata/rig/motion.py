"""Expected events of a video by time and position on the sensor, from PIX2NVS."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np

from nvsdata.data.events import Events
from nvsdata.data.grid import grid_shape
from nvsdata.emulation.pix2nvs import PIX2NVS
from nvsdata.emulation.pix2nvs_state import PIX2NVSState
from nvsdata.rig.monitor import Monitor
from nvsdata.video.frames import TruncatedVideo, VideoFrame, frames_of

BIN = 50_000  # µs per bin of time
CELL = 20  # pixels per cell of the sensor, along each side
# a screen changes at the time of a frame, not gradually before it, so timestamps are fixed
PIXELS = PIX2NVS(t_log=20, continuous=True, new=False, exp=False, max_events=8, timestamps="fixed")


def histogram(events: Events, start: int, bins: int, width: int) -> np.ndarray:
    """Count events by cell of pixels and by bin of `width` µs from `start` on, [bins, cells]."""
    columns, rows = grid_shape(events.sensor_size, (CELL, CELL))
    cell = (events.y // CELL).astype(np.intp) * columns + events.x // CELL
    key = ((events.t - start) // width) * (columns * rows) + cell
    return np.bincount(key, minlength=bins * columns * rows).reshape(bins, columns * rows).astype(np.float64)


def emulated(
    video: Path, monitor: Monitor, corners: np.ndarray, size: tuple[int, int], bins: int, drift: float = 0.0
) -> np.ndarray:
    """Count the events that PIX2NVS emulates for a video on the screen, by time bin and cell, float64 [bins, cells].

    Bins are `BIN` µs long, from the beginning of the video on. Cells are `CELL` x `CELL` pixels, row by row.

    Args:
        video: The video.
        monitor: Monitor that shows it.
        corners: Corners of the screen on the sensor, from its upper left clockwise, in pixels, float32 [4, 2].
        size: (width, height) of the sensor.
        bins: Number of bins of time.
        drift: Relative drift of the camera's clock against the host's (default 0).
    """
    columns, rows = grid_shape(size, (CELL, CELL))
    counts = np.zeros((bins, columns * rows))
    run: PIX2NVSState | None = None
    for frame in _seen(video, monitor, corners, size):
        if run is None:
            run = PIXELS.begin(frame)
            continue
        events = run.step(frame._replace(time=round(frame.time * (1 + drift)))).events().window(None, bins * BIN)
        if len(events):
            first, last = int(events.t[0]) // BIN, int(events.t[-1]) // BIN
            counts[first : last + 1] += histogram(events, first * BIN, last + 1 - first, BIN)
    return counts


def _seen(video: Path, monitor: Monitor, corners: np.ndarray, size: tuple[int, int]) -> Iterator[VideoFrame]:
    """Yield the video's frames as they appear on the sensor."""
    wide, high = monitor.size
    screen = np.array([(0, 0), (wide, 0), (wide, high), (0, high)], np.float32)
    view = cv2.getPerspectiveTransform(screen, corners)
    try:
        for frame in frames_of(video):
            height, width = frame.pixels.shape[:2]
            x, y, w, h = monitor.place_of(width, height)
            # scaled to about twice the sensor's resolution first, so that each pixel is the mean of an area
            small = min(1.0, 2 * size[0] * w / wide / width)
            pixels = frame.pixels
            if small < 1:
                pixels = cv2.resize(pixels, None, fx=small, fy=small, interpolation=cv2.INTER_AREA)
            height, width = pixels.shape[:2]
            onto = np.array([(w / width, 0, x), (0, h / height, y), (0, 0, 1)])
            seen = np.asarray(cv2.warpPerspective(pixels, view @ onto, size))
            yield frame._replace(pixels=seen)
    except TruncatedVideo:
        return
