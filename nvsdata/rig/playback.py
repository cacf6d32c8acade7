"""Playback of a video on a monitor between two flash patterns, with a log of the times."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from itertools import chain, islice
from pathlib import Path

import numpy as np

from nvsdata.recording.camera import host_time
from nvsdata.rig.clock_fit import flashes
from nvsdata.rig.monitor import Monitor
from nvsdata.video.frames import TruncatedVideo, VideoFrame, frames_of

# levels of the flashes: enough contrast for a few events per pixel, but few enough for a quick readout
DIM, BRIGHT = 108, 148
STEP = 3  # refreshes that a step of the pattern lasts
STILL = 300_000  # µs of a still screen before and after each pattern
SETTLE = 2_000_000  # µs that the first frame is shown before the video moves: pixels adapt to it (Hu et al. 2016)
FADE = 400_000  # µs from the dim level to the first frame, and from the last one back: a jump overruns the readout
COUNTED = 100_000  # µs before the video moves at which the camera's drops are counted
LATE = 20_000  # µs by which a frame may be late on any screen, which eyes and pixels don't notice
LOOKED_AT = 12  # frames whose rate is compared with the screen's
TOO_FAST = 0.995  # fraction of a refresh; if frames are closer together, too many would be left out
USUAL_GAP = 40_000  # µs that the only frame of a video is shown


@dataclass
class PlaybackLog:
    """Log of the times of frames and flashes; host times in µs.

    Args:
        refresh: Time between two refreshes of the monitor (µs).
        flashes: Times at which the entire screen changed.
        bright: True for changes to bright, False for changes to dim.
        start: Time of the first frame of the video.
        stop: End of the video.
        due: Time at which each frame of the video was due.
        shown: Time at which each of them was shown.
        frames: Number of frames of the video.
        late: Number of frames that were shown more than a refresh after they were due.
        skipped: Number of frames that weren't shown, because the next one was already due.
        wrong: Time in ms for which the screen showed an outdated frame, not counting delays up to a refresh or 20 ms.
        truncated: Reason for an early end of the video, None for a complete one.
        dropped: Number of events that the camera dropped during the video, None if the camera doesn't count them.
    """

    refresh: float
    flashes: list[float] = field(default_factory=list)
    bright: list[bool] = field(default_factory=list)
    start: float = 0.0
    stop: float = 0.0
    due: list[float] = field(default_factory=list)
    shown: list[float] = field(default_factory=list)
    frames: int = 0
    late: int = 0
    skipped: int = 0
    wrong: float = 0.0
    truncated: str | None = None
    dropped: int | None = None

    def add(self, due: float, shown: float) -> None:
        """Add a frame that was shown."""
        self.due.append(due)
        self.shown.append(shown)
        self.frames += 1
        self.late += shown - due > self.refresh
        self.wrong += max(shown - due - max(self.refresh, LATE), 0) / 1e3

    def skip(self, duration: float) -> None:
        """Count a frame that should have been shown for `duration` µs."""
        self.frames += 1
        self.skipped += 1
        self.wrong += duration / 1e3


def perform(monitor: Monitor, video: Path, dropped: Callable[[], int | None] = lambda: None) -> PlaybackLog:
    """Show a video at its own speed, between flash patterns.

    Args:
        monitor: The monitor.
        video: The video.
        dropped: Function that returns the number of events that the camera has dropped. It is called just before the
            video moves, and at the end of the video.

    Raises:
        FormatError: The file has no frame that can be decoded. Nothing is shown.
        FileNotFoundError: There is no such file.
        ValueError: The video has more frames per second than the screen shows.
    """
    done = PlaybackLog(monitor.refresh)
    frames = frames_of(video)
    try:
        begin = _begin(frames, done)
        _check_rate(begin, monitor.refresh)
        first, others = begin[0], chain(begin[1:], frames)
        _flash(monitor, done)
        monitor.fade(DIM, first, FADE)
        done.start = monitor.show(first) + SETTLE
        monitor.wait(done.start - COUNTED)
        before = dropped()
        last = _play(monitor, done, first, others)
        monitor.wait(done.stop)
        after = dropped()
        done.dropped = None if before is None or after is None else after - before
        monitor.fade(DIM, last, FADE, back=True)
        _flash(monitor, done)
    finally:
        if hasattr(frames, "close"):
            frames.close()
    return done


def _begin(frames: Iterator[VideoFrame], done: PlaybackLog) -> list[VideoFrame]:
    """Return the first `LOOKED_AT` frames, or fewer if the video is short or truncated."""
    return list(_to_the_end(islice(frames, LOOKED_AT), done))


def _check_rate(frames: list[VideoFrame], refresh: float) -> None:
    if len(frames) < LOOKED_AT:
        return
    gap = float(np.median(np.diff([frame.time for frame in frames])))
    if gap < TOO_FAST * refresh:
        rates = f"{1e6 / gap:.0f} frames per second, but the screen shows {1e6 / refresh:.0f}"
        raise ValueError(f"the video has {rates}: use a faster screen, or reduce the frame rate of the video")


def _play(monitor: Monitor, done: PlaybackLog, first: VideoFrame, others: Iterator[VideoFrame]) -> VideoFrame:
    """Show the frames after the first one, except those whose successor is already due; return the last frame."""
    done.add(done.start, done.start)
    waiting: VideoFrame | None = None
    last, gap = first.time, USUAL_GAP
    for frame in _to_the_end(others, done):
        if waiting is not None:
            _in_turn(monitor, done, waiting, done.start + frame.time)
        gap, last = frame.time - last, frame.time
        waiting = frame
    if waiting is not None:
        _in_turn(monitor, done, waiting, float("inf"))
    done.stop = done.start + last + gap
    return waiting or first


def _to_the_end(frames: Iterator[VideoFrame], done: PlaybackLog) -> Iterator[VideoFrame]:
    try:
        yield from frames
    except TruncatedVideo as error:
        done.truncated = str(error)


def _in_turn(monitor: Monitor, done: PlaybackLog, frame: VideoFrame, next_due: float) -> None:
    due = done.start + frame.time
    if host_time() > next_due - monitor.refresh / 2:
        done.skip(next_due - due)
    else:
        done.add(due, monitor.show(frame, due))


def pattern(monitor: Monitor, show: Callable[[bool, float | None], float]) -> tuple[list[float], list[bool]]:
    """Show the flash pattern, with a still screen before and after it.

    Args:
        monitor: The monitor.
        show: Function that shows the bright image (True) or the dim image (False) at a host time (µs), and returns the
            actual time, as `Monitor.show` does.

    Returns:
        The host times (µs) of the changes, and True for each change to bright, False for each change to dim.
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
    """Show the pattern on the entire screen."""
    times, rising = pattern(monitor, lambda bright, due: monitor.fill(BRIGHT if bright else DIM, due))
    done.flashes += times
    done.bright += rising
