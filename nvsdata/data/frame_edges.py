"""Which events fall into which frame."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from nvsdata.data.events import EVER, LATEST, Events

MICROSECONDS = 1_000_000
MAX_FRAMES = 1 << 24  # frames in a sequence, six days at 30 per second: more means that a clock is wrong


def frame_edges(duration: int, fps: float | None) -> np.ndarray:
    """Edges in µs of the frames of 1 / `fps` s that cover 0 to `duration` (µs): int64 [frames + 1].

    `fps` None: a single frame. ValueError for more than 2^24 frames.
    """
    if fps is None:
        return np.array([0, max(duration, 1)])
    count = math.ceil(min(duration * fps / MICROSECONDS, 1e18))
    if count > MAX_FRAMES:
        seconds = duration / MICROSECONDS
        raise ValueError(f"{seconds:,.0f} s are {count:,} frames: do the events begin when they say (`Events.start`)?")
    # one more, because rounding may move the last edge before the end
    with np.errstate(over="ignore"):
        edges = np.round(np.arange(count + 2) * MICROSECONDS / fps)
    # one beyond the end may be beyond int64, too
    last = max(duration, LATEST)
    edges = np.where(edges < last, edges, -1).astype(np.int64)
    edges[edges < 0] = last
    return edges[: max(int(np.searchsorted(edges, duration)), 1) + 1]


def frame_bounds(events: Events, origin: int, edges: np.ndarray) -> np.ndarray:
    """Index of the first event of each frame, and the end of the last: int64 [frames + 1]; `edges` count from `origin`.

    A frame has the events after its beginning up to and including its end, because an emulator's events of frame F_n
    may lie at F_n exactly; the first frame also has the events at its beginning.
    """
    bounds = np.searchsorted(events.t, origin + edges, "right")
    bounds[0] = np.searchsorted(events.t, origin, "left")
    return bounds


def equal_bounds(events: Events, count: int) -> np.ndarray:
    """Bounds, as in `frame_bounds`, of `count` frames of equal duration, half open but for the last one.

    They cover `events.start` to `events.end`; an event at t is in frame floor(count (t - start) / (end - start)), one
    at the end in the last.
    """
    check_count(count)
    return share_bounds(events, events.start, events.end, [(n, count) for n in range(count)])


def share_bounds(events: Events, start: int, end: int, shares: Sequence[tuple[int, int]]) -> np.ndarray:
    """Bounds of frames that begin at shares a / b of the time from `start` to `end` (µs); the last one never ends."""
    # at least 1, so that events at one time are in the first frame
    duration = max(end - start, 1)
    # whole numbers of any size: a product of times may not fit int64
    return _bounds(events, np.array([start - (-duration * a // b) for a, b in shares]))


def duration_bounds(events: Events, duration: int) -> np.ndarray:
    """Bounds of frames of `duration` µs from `events.start` on, at least one, half open but for the last one.

    ValueError for more than 2^24 frames.
    """
    count = max(-(-(events.end - events.start) // int(duration)), 1)
    check_count(count)
    return _bounds(events, events.start + np.arange(count) * min(int(duration), EVER[1]))


def count_bounds(events: Events, count: int) -> np.ndarray:
    """Bounds of frames of `count` events, at least one; the last one has those left over."""
    frames = max(-(-len(events) // int(count)), 1)
    check_count(frames)
    return np.minimum(np.arange(frames + 1) * int(count), len(events))


def check_count(frames: int) -> None:
    """ValueError for more than 2^24 frames."""
    if frames > MAX_FRAMES:
        raise ValueError(f"that would be {frames:,} frames, more than {MAX_FRAMES:,}")


def _bounds(events: Events, begins: np.ndarray) -> np.ndarray:
    return np.append(np.searchsorted(events.t, begins, "left"), len(events))
