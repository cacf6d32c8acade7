"""Boundaries between frames of events."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from nvsdata.data.events import EVER, LATEST, Events

MICROSECONDS = 1_000_000
MAX_FRAMES = 1 << 24  # frames in a sequence (six days at 30 per second); more frames show that times are wrong


def frame_edges(duration: int, fps: float | None) -> np.ndarray:
    """Return the edges in µs, int64 [frames + 1], of the frames of 1 / `fps` s that cover 0 to `duration` (µs).

    `fps` None makes a single frame. ValueError for more than 2^24 frames.
    """
    if fps is None:
        return np.array([0, max(duration, 1)])
    count = math.ceil(min(duration * fps / MICROSECONDS, 1e18))
    if count > MAX_FRAMES:
        seconds = duration / MICROSECONDS
        raise ValueError(
            f"{seconds:,.0f} s are {count:,} frames, which are too many: check `Events.start` and the times"
        )
    # one edge more, because rounding may move the last edge before the end
    with np.errstate(over="ignore"):
        edges = np.round(np.arange(count + 2) * MICROSECONDS / fps)
    # an edge beyond the end may also be beyond int64
    last = max(duration, LATEST)
    edges = np.where(edges < last, edges, -1).astype(np.int64)
    edges[edges < 0] = last
    return edges[: max(int(np.searchsorted(edges, duration)), 1) + 1]


def frame_bounds(events: Events, origin: int, edges: np.ndarray) -> np.ndarray:
    """Return the index of the first event of each frame, and the end of the last frame: int64 [frames + 1].

    `edges` (µs) are relative to the time `origin`. A frame contains the events after its start, up to and including its
    end, because events emulated from a video's frame may have exactly that frame's time. The first frame also contains
    the events at its start.
    """
    bounds = np.searchsorted(events.t, origin + edges, "right")
    bounds[0] = np.searchsorted(events.t, origin, "left")
    return bounds


def equal_bounds(events: Events, count: int) -> np.ndarray:
    """Return bounds, as `frame_bounds` does, of `count` frames of equal duration.

    The frames cover `events.start` to `events.end`. An event at t is in frame floor(count (t - start) / (end - start));
    an event at the end is in the last frame.
    """
    check_count(count)
    return fraction_bounds(events, events.start, events.end, [(n, count) for n in range(count)])


def fraction_bounds(events: Events, start: int, end: int, fractions: Sequence[tuple[int, int]]) -> np.ndarray:
    """Return bounds, as `frame_bounds` does, of frames that begin at fractions a / b of the time `start` to `end`."""
    # at least 1, so that events at one time are in the first frame
    duration = max(end - start, 1)
    # Python's integers, because a product of times may not fit int64
    return _bounds(events, np.array([start - (-duration * a // b) for a, b in fractions]))


def duration_bounds(events: Events, duration: int) -> np.ndarray:
    """Return bounds, as `frame_bounds` does, of frames of `duration` µs from `events.start` on, at least one frame.

    A frame contains the events at its start, but not those at its end; the last frame contains both. ValueError for
    more than 2^24 frames.
    """
    count = max(-(-(events.end - events.start) // int(duration)), 1)
    check_count(count)
    return _bounds(events, events.start + np.arange(count) * min(int(duration), EVER[1]))


def count_bounds(events: Events, count: int) -> np.ndarray:
    """Return bounds, as `frame_bounds` does, of frames of `count` events, at least one; the last may have fewer."""
    frames = max(-(-len(events) // int(count)), 1)
    check_count(frames)
    return np.minimum(np.arange(frames + 1) * int(count), len(events))


def check_count(frames: int) -> None:
    """Raise ValueError for more than 2^24 frames."""
    if frames > MAX_FRAMES:
        raise ValueError(f"{frames:,} frames are more than the {MAX_FRAMES:,} allowed: use longer frames")


def _bounds(events: Events, begins: np.ndarray) -> np.ndarray:
    return np.append(np.searchsorted(events.t, begins, "left"), len(events))
