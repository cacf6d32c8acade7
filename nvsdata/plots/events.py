"""A picture of events."""

from __future__ import annotations

import numpy as np

from nvsdata.data.events import Events
from nvsdata.plots.drawing import BOTH, OFF, ON


def event_image(events: Events, zoom: int = 1) -> np.ndarray:
    """Events on white: pixels with ON events red, with OFF events blue, with both purple.

    - `events`: all are drawn, whatever their times
    - `zoom`: side in pixels that each pixel of the sensor gets (default 1)

    Returns uint8 [H * zoom, W * zoom, 3], BGR.
    """
    width, height = events.sensor_size
    picture = np.full((height, width, 3), 255, np.uint8)
    seen = np.zeros((2, height, width), bool)
    seen[events.p, events.y, events.x] = True
    picture[seen[1]], picture[seen[0]], picture[seen[0] & seen[1]] = ON, OFF, BOTH
    return picture.repeat(zoom, 0).repeat(zoom, 1)


def middle(events: Events, duration: int) -> Events:
    """The events of `duration` µs in the middle."""
    start = (events.start + events.end) // 2 - duration // 2
    return events.window(start, start + duration)
