"""A video on a monitor between two flash patterns, and when all of it was shown."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from nvsdata.common.clock import host_time
from nvsdata.recording.rig.clock_fit import flashes
from nvsdata.recording.rig.monitor import Monitor
from nvsdata.video.frames import Frame, TruncatedVideo, frames_of

# levels of the flashes: enough contrast for a few events per pixel, but not so much that the readout takes long
DIM, BRIGHT = 108, 148
STEP = 3  # refreshes that a step of the pattern lasts
STILL = 300_000  # µs of a still screen before and after each pattern
SETTLE = 2_000_000  # µs that the first picture is shown before the video moves: pixels adapt to it (Hu et al. 2016)
USUAL_GAP = 40_000  # µs that the only picture of a video is shown


@dataclass
class PlaybackLog:
    """What was shown when; host times in µs.

    - `refresh`: time between two refreshes of the monitor (µs)
    - `flashes`, `bright`: when the whole screen changed, and whether to bright (True) or to dim
    - `start`, `stop`: from when to when the video lasted
    - `due`, `shown`: when each picture of the video was due, and when it was shown
    - `skipped`: pictures that weren't shown, because the next one was already due
    - `truncated`: why the video ended early, None if it didn't
    """

    refresh: float
    flashes: list[float] = field(default_factory=list)
    bright: list[bool] = field(default_factory=list)
    start: float = 0.0
    stop: float = 0.0
    due: list[float] = field(default_factory=list)
    shown: list[float] = field(default_factory=list)
    skipped: int = 0
    truncated: str | None = None

    @property
    def late(self) -> int:
        """Pictures shown more than a refresh after they were due."""
        return int((np.array(self.shown) - np.array(self.due) > self.refresh).sum())

    @property
    def frames(self) -> int:
        """Pictures of the video."""
        return len(self.due) + self.skipped

    def log(self) -> dict[str, Any]:
        """All of it as JSON can hold it, with times in whole µs from the video's first moment."""

        def after(times: list[float]) -> list[int]:
            return [round(time - self.start) for time in times]

        return {
            "refresh": round(self.refresh, 1),
            "late": self.late,
            "skipped": self.skipped,
            "flashes": after(self.flashes),
            "due": after(self.due),
            "shown": after(self.shown),
            "stop": round(self.stop - self.start),
            "bright": [int(bright) for bright in self.bright],
        }


def perform(monitor: Monitor, video: Path) -> PlaybackLog:
    """Show a video, paced by its own times, between flash patterns.

    FormatError or FileNotFoundError, before anything is shown, for a file without a picture. `Monitor` lists others.
    """
    done = PlaybackLog(monitor.refresh)
    frames = frames_of(video)
    try:
        first = next(frames)
        _flash(monitor, done)
        shown = monitor.show(first)
        done.start = shown + SETTLE
        _play(monitor, done, first, frames)
        monitor.wait(done.stop)
        _flash(monitor, done)
    finally:
        if hasattr(frames, "close"):
            frames.close()
    return done


def _play(monitor: Monitor, done: PlaybackLog, first: Frame, others: Iterator[Frame]) -> None:
    """Show the pictures after the first; those whose successor is due are skipped."""
    done.due.append(done.start)
    done.shown.append(done.start)
    waiting: Frame | None = None
    last, gap = first.time, USUAL_GAP
    for frame in _to_the_end(others, done):
        if waiting is not None:
            _in_turn(monitor, done, waiting, done.start + frame.time)
        gap, last = frame.time - last, frame.time
        waiting = frame
    if waiting is not None:
        _in_turn(monitor, done, waiting, float("inf"))
    done.stop = done.start + last + gap


def _to_the_end(frames: Iterator[Frame], done: PlaybackLog) -> Iterator[Frame]:
    try:
        yield from frames
    except TruncatedVideo as error:
        done.truncated = str(error)


def _in_turn(monitor: Monitor, done: PlaybackLog, frame: Frame, next_due: float) -> None:
    if host_time() > next_due - monitor.refresh / 2:
        done.skipped += 1
        return
    due = done.start + frame.time
    done.shown.append(monitor.show(frame, due))
    done.due.append(due)


def pattern(monitor: Monitor, show: Callable[[bool, float | None], float]) -> tuple[list[float], list[bool]]:
    """Show the flash pattern, with a still screen before and after it.

    `show` is called with whether to show the bright picture (else the dim one) and when, and returns when it was shown,
    as `Monitor.show` does. Returns the host times (µs) of the changes, and whether each was to bright.
    """
    began = show(False, None) + STILL
    times: list[float] = []
    rising: list[bool] = []
    bright = False
    for step, bit in enumerate((*flashes().tolist(), 0)):
        if bool(bit) != bright:
            bright = bool(bit)
            times.append(show(bright, began + step * STEP * monitor.refresh))
            rising.append(bright)
    monitor.wait(host_time() + STILL)
    return times, rising


def _flash(monitor: Monitor, done: PlaybackLog) -> None:
    """Show the pattern on the whole screen."""
    times, rising = pattern(monitor, lambda bright, due: monitor.fill(BRIGHT if bright else DIM, due))
    done.flashes += times
    done.bright += rising
