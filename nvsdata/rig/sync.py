"""Alignment of host and camera clocks of a take, by flashes in the events, and in triggers if there are any."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from nvsdata import formats
from nvsdata.data.events import Events, concatenate
from nvsdata.recording.capture import RecordingReport
from nvsdata.rig.clock_fit import GROUP, MOST_DRIFT, ClockFit, NoSync, fit_clock
from nvsdata.rig.playback import PlaybackLog

AROUND = 500_000  # µs that are read before and after the flashes
APART = 5_000  # µs by which events and triggers may differ: a screen changes line by line, and pixels have a latency
MARGIN = 50_000  # µs around a group of flashes in which nothing else may trigger
STRAY = 0.1  # allowed triggers without a flash, as a fraction of the flashes


class TakeRejected(Exception):
    """A take (an attempt to record a video) must be repeated; the message has the reason."""


@dataclass
class ScreenRecording:
    """Uncut recording of a video that was played on the monitor.

    Args:
        raw: The uncut recording.
        report: Report of the recording.
        performance: Log of the playback.
    """

    raw: Path
    report: RecordingReport
    performance: PlaybackLog


class Sync(NamedTuple):
    """Clock fit of a take.

    Args:
        line: The fit.
        by: Source of the fit, "triggers" or "events".
        refused: Reason why triggers weren't used; None if they were, or if there were none.
    """

    line: ClockFit
    by: str
    refused: str | None = None


def synced(take: ScreenRecording) -> Sync:
    """Fit camera time to host time, by the flashes before and after the video.

    The fit is to the external triggers if they show the flashes and hardly anything else, otherwise to the events.

    Raises:
        NoSync: The events don't show the flashes, so the camera doesn't see the screen; or the fits to events and to
            triggers are more than 5 ms apart.
    """
    done = take.performance
    shown, bright = np.array(done.flashes), np.array(done.bright)
    line = fit_clock(around_flashes(take), shown, bright)
    triggers = np.array(take.report.triggers, np.float64)
    if not triggers.size:
        return Sync(line, "events")
    try:
        _check_due(triggers, line, shown[bright])
        other = fit_clock(take.report.triggers, shown, bright)
    except NoSync as error:
        return Sync(line, "events", str(error))
    apart = max(abs(line.camera(time) - other.camera(time)) for time in (done.start, done.stop))
    if apart > APART:
        raise NoSync(
            f"flashes in the events and in the triggers are {apart / 1e3:.1f} ms apart: check what causes triggers"
        )
    return Sync(other, "triggers")


def _check_due(triggers: np.ndarray, line: ClockFit, rising: np.ndarray) -> None:
    """Raise `NoSync` if a group of flashes has more triggers than changes from dim to bright (`rising`)."""
    for first in rising[np.diff(rising, prepend=-np.inf) > GROUP]:
        group = rising[(rising >= first) & (rising < first + GROUP)]
        ends = line.camera(group[0]) - MARGIN, line.camera(group[-1]) + MARGIN
        there = int(np.count_nonzero((triggers >= ends[0]) & (triggers <= ends[1])))
        if there > group.size * (1 + STRAY) + 1:
            raise NoSync(f"{there} triggers among {group.size} flashes: something else triggers, too")


def around_flashes(take: ScreenRecording) -> Events:
    """Return the events at the times of the flashes, which come before and after the video."""
    recording = formats.open(take.raw)
    flashes, start = np.array(take.performance.flashes), take.performance.start
    windows: list[tuple[int, int]] = []
    for group in (flashes[flashes < start], flashes[flashes >= start]):
        first, last = group[[0, -1]] - take.report.zero
        lo, hi = first * (1 - MOST_DRIFT) - AROUND, last * (1 + MOST_DRIFT) + AROUND
        lo = max(int(lo), windows[-1][1] if windows else 0)
        windows.append((lo, max(int(hi), lo)))
    return Events.trusted(concatenate([recording.read(*window).columns for window in windows]), recording.sensor_size)
