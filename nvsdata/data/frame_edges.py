"""Which events fall into which frame."""

from __future__ import annotations

import math

import numpy as np

from nvsdata.data.events import Events

MICROSECONDS = 1_000_000
MOST = 1 << 24  # frames of a sequence, six days of 30 a second: more is a clock that is off


def frame_edges(duration: int, fps: float | None) -> np.ndarray:
    """µs at which frames of 1 / `fps` s begin and end that cover 0 to `duration`: int64 [frames + 1].

    None: a single frame.
    """
    if fps is None:
        return np.array([0, max(duration, 1)])
    count = math.ceil(duration * fps / MICROSECONDS) + 1
    if count > MOST:
        seconds = duration / MICROSECONDS
        raise ValueError(f"{seconds:,.0f} s are {count:,} frames: do the events begin when they say (`Events.start`)?")
    edges = np.round(np.arange(count + 1) * MICROSECONDS / fps).astype(np.int64)
    return edges[: max(int(np.searchsorted(edges, duration)), 1) + 1]


def frame_bounds(events: Events, origin: int, edges: np.ndarray) -> np.ndarray:
    """Index of the first event of each frame, and after the last: int64 [frames + 1]; `edges` count from `origin`.

    A frame has the events after its beginning up to its end, for what an emulator makes of frame F_n
    may lie at F_n exactly; the first has those at its beginning, too.
    """
    bounds = np.searchsorted(events.t, origin + edges, "right")
    bounds[0] = np.searchsorted(events.t, origin, "left")
    return bounds
