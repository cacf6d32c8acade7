"""Which events fall into which frame."""

from __future__ import annotations

import math

import numpy as np

from nvsdata.data.events import Events

MICROSECONDS = 1_000_000
MAX_FRAMES = 1 << 24  # frames in a sequence, six days at 30 per second: more means that a clock is wrong


def frame_edges(duration: int, fps: float | None) -> np.ndarray:
    """Edges in µs of the frames of 1 / `fps` s that cover 0 to `duration` (µs): int64 [frames + 1].

    `fps` None: a single frame. ValueError for more than 2^24 frames.
    """
    if fps is None:
        return np.array([0, max(duration, 1)])
    count = math.ceil(duration * fps / MICROSECONDS) + 1
    if count > MAX_FRAMES:
        seconds = duration / MICROSECONDS
        raise ValueError(f"{seconds:,.0f} s are {count:,} frames: do the events begin when they say (`Events.start`)?")
    edges = np.round(np.arange(count + 1) * MICROSECONDS / fps).astype(np.int64)
    return edges[: max(int(np.searchsorted(edges, duration)), 1) + 1]


def frame_bounds(events: Events, origin: int, edges: np.ndarray) -> np.ndarray:
    """Index of the first event of each frame, and the end of the last: int64 [frames + 1]; `edges` count from `origin`.

    A frame has the events after its beginning up to and including its end, because an emulator's events of frame F_n
    may lie at F_n exactly; the first frame also has the events at its beginning.
    """
    bounds = np.searchsorted(events.t, origin + edges, "right")
    bounds[0] = np.searchsorted(events.t, origin, "left")
    return bounds
