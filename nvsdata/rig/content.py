"""Quality of a recording of a video, by comparison with the events that PIX2NVS emulates for the video."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from nvsdata.data.frame_edges import MICROSECONDS
from nvsdata.data.recording import Recording
from nvsdata.rig import playback
from nvsdata.rig.calibration import outline_of, response
from nvsdata.rig.clock_fit import ClockFit, NoSync
from nvsdata.rig.monitor import Monitor
from nvsdata.rig.motion import BIN, emulated, histogram
from nvsdata.rig.sync import ScreenRecording, TakeRejected, around_flashes

BLOCK = 5  # bins of a block, within which events may be early or late
FEWEST = 1_000  # emulated events in the busiest second that a comparison needs
ABSENT = 0.1  # fraction of the expected events below which they count as missing
SILENT = 30  # expected noise events from which a time without any event means that events are missing
COUNTED = 50  # expected events from which their absence is significant
# limits beyond which a recording is flagged; those in `RELATIVE` are relative to the median of the other recordings
LONGEST_GAP = 100.0  # ms
LEAST_COVER = 0.25  # fraction of the sensor
MOST_ASPECT = 1.35  # factor by which the screen's aspect ratio may be off
MOST_HIDDEN, MOST_STRAY, MOST_NOISE = 0.25, 0.2, 10.0
LEAST_SCALE, MOST_SCALE = 0.1, 10.0
RELATIVE = {"scale": (0.3, 3.3), "cover": (0.8, 1.25), "seen": (0.7, np.inf)}
MOVED = 5.0  # pixels by which a corner may be off
ENOUGH = 3  # recordings from which their median is used


@dataclass(frozen=True)
class Content:
    """Measured quality of a recording.

    Args:
        emulated: Number of events that PIX2NVS emulates for the video, as it appears on the sensor.
        scale: Recorded events per emulated event, median over time; None for a quiet video.
        gap: Longest time in ms without events while the video moves.
        hidden: Fraction of the video's motion that is in parts of the sensor without events.
        stray: Fraction of the recorded events that the video's motion doesn't explain.
        noise: Event rate in Hz per pixel while the first frame is still.
        cover: Fraction of the sensor that the screen covers.
        seen: Mean fraction of the flashes that a pixel of the screen recorded.
        corners: Corners of the screen on the sensor, clockwise from the upper left, [4, 2] in pixels, or None.
    """

    emulated: int
    scale: float | None
    gap: float
    hidden: float
    stray: float
    noise: float
    cover: float
    seen: float
    corners: list[list[float]] | None

    @property
    def quiet(self) -> bool:
        """True if the video moves so little that few events are expected."""
        return self.scale is None and self.corners is not None

    def as_dict(self) -> dict[str, Any]:
        """Return the values for a manifest."""
        return {k: round(v, 4) if isinstance(v, float) else v for k, v in asdict(self).items()}


class Span(NamedTuple):
    """A take with its clock fit; the video lasts from `start` to `stop` (µs, camera time)."""

    take: ScreenRecording
    recording: Recording
    line: ClockFit
    start: int
    stop: int


@dataclass(frozen=True)
class Inspector:
    """Check of the recordings of a batch, each compared with those before it.

    Args:
        monitor: Monitor that shows the videos.
        corners: Corners of the screen on the sensor, by calibration, [4, 2] (default: the median of other recordings).
        others: Quality of the batch's recordings so far, as `Content.as_dict` returns it.
        strict: Reject flagged recordings (default False: only list them).
        accept_quiet: Accept recordings with hardly any events of videos that move (default False).
    """

    monitor: Monitor
    corners: list[list[float]] | None = None
    others: list[dict[str, Any]] = field(default_factory=list)
    strict: bool = False
    accept_quiet: bool = False

    def judged(self, span: Span, video: Path, events: int) -> dict[str, Any]:
        """Return the manifest's fields for a recording with `events` events: its quality, and reasons for a review.

        Raises:
            TakeRejected: The recording has too few events, or, if `strict` is true, there are reasons for a review.
        """
        found, seconds = self.measure(span, video), (span.stop - span.start) / MICROSECONDS
        fewest = FEWEST * seconds
        if found.emulated:
            # a video may move only for a moment
            fewest = min(fewest, LEAST_SCALE * found.emulated)
        if not (found.quiet or self.accept_quiet) and events < fewest:
            due = (
                f"the video's motion should cause about {found.emulated}"
                if found.emulated
                else "hardly any pixel saw the screen"
            )
            raise TakeRejected(f"{events} events in {seconds:.2f} s are too few: {due}")
        doubts = self.doubts(found)
        if self.strict and doubts:
            raise TakeRejected("; ".join(doubts))
        return {"content": found.as_dict()} | ({"review": doubts} if doubts else {})

    def measure(self, span: Span, video: Path) -> Content:
        """Measure the quality of a take of a video."""
        size = span.recording.sensor_size
        corners, cover, seen = self._screen(span)
        place = self.corners or corners or self._usual("corners")
        bins = max(-(-(span.stop - span.start) // BIN), 1)
        found, silence = _counts(span.recording, span.start, span.stop, bins)
        noise = _noise(span, size)
        if place is None:
            lost = {"scale": None, "gap": 0.0, "hidden": 1.0, "stray": 0.0}
            return Content(0, **lost, noise=noise.hertz, cover=cover, seen=seen, corners=None)  # type: ignore[arg-type]
        due = emulated(video, self.monitor, np.array(place, np.float32), size, bins, span.line.drift)
        scale, gap, hidden, stray = _compared(found, due, noise.counts)
        if silence * noise.hertz * size[0] * size[1] / MICROSECONDS > SILENT:
            # if there isn't even noise, events are missing
            gap = max(gap, silence / 1e3)
        return Content(int(due.sum()), scale, gap, hidden, stray, noise.hertz, cover, seen, corners)

    def _screen(self, span: Span) -> tuple[list[list[float]] | None, float, float]:
        """Find the screen on the sensor; return the fields `corners`, `cover` and `seen` of `Content`."""
        done = span.take.performance
        share = response(around_flashes(span.take), span.line, done.flashes, done.bright)
        try:
            corners, mask = outline_of(share)
        except NoSync:
            return None, 0.0, 0.0
        # the camera is assumed to be upright
        corners = np.roll(corners, -int(corners.sum(1).argmin()), 0)
        return corners.round(2).tolist(), float(mask.mean()), float(share[mask].mean())

    def doubts(self, found: Content) -> list[str]:
        """Return reasons for a review of a recording; empty if there are none."""
        reasons = []
        if found.corners is None:
            reasons.append("too few pixels see the screen")
        elif self.corners is None:
            reasons += self._unusual_view(found.corners, found.cover)
        if found.gap > LONGEST_GAP:
            reasons.append(f"no events for {found.gap:.0f} ms in which the video moves")
        if found.hidden > MOST_HIDDEN:
            reasons.append(
                f"{found.hidden:.0%} of the video's motion caused no events: something is in front of the screen"
            )
        if found.stray > MOST_STRAY:
            reasons.append(f"{found.stray:.0%} of the events are where, or when, nothing moves in the video")
        if found.noise > MOST_NOISE:
            reasons.append(f"{found.noise:.0f} Hz of noise per pixel before the video")
        if found.scale is not None and not LEAST_SCALE <= found.scale <= MOST_SCALE:
            reasons.append(f"{found.scale:.2g} times the events that the video's motion should cause")
        return reasons + self._compared_with_others(found)

    def _unusual_view(self, corners: list[list[float]], cover: float) -> list[str]:
        """Return reasons for a review by the screen's position on the sensor, without a calibration."""
        sides = np.hypot(*np.diff(np.array([*corners, corners[0]]), axis=0).T)
        wide, high = (sides[0] + sides[2]) / 2, (sides[1] + sides[3]) / 2
        aspect = wide / max(high, 1) * self.monitor.size[1] / self.monitor.size[0]
        if not 1 / MOST_ASPECT <= aspect <= MOST_ASPECT:
            return [f"the screen is seen as {wide:.0f}x{high:.0f} pixels: is part of it out of view, or hidden?"]
        return [f"the screen fills {cover:.0%} of the view"] if cover < LEAST_COVER else []

    def _compared_with_others(self, found: Content) -> list[str]:
        reasons = []
        names = {
            "scale": "recorded events per emulated event",
            "cover": "fraction of the sensor that sees the screen",
            "seen": "fraction of the flashes that a pixel recorded",
        }
        for name, (low, high) in RELATIVE.items():
            value, usual = getattr(found, name), self._usual(name)
            if value is not None and usual and not low <= value / usual <= high:
                reasons.append(f"{names[name]}: {value:.2g}, in the other recordings {usual:.2g}")
        usual_corners = self.corners or self._usual("corners")
        if found.corners is not None and usual_corners is not None:
            away = float(np.hypot(*(np.array(found.corners) - usual_corners).T).max())
            if away > MOVED:
                reasons.append(f"the screen's corners are {away:.0f} pixels from where they were: did something move?")
        return reasons

    def _usual(self, name: str) -> Any:
        """Return the median of a value over the other recordings, None if there are too few."""
        values = [other[name] for other in self.others if other.get(name) is not None]
        return np.median(np.array(values), 0) if len(values) >= ENOUGH else None


class _Noise(NamedTuple):
    counts: np.ndarray  # expected noise events per bin, [cells]
    hertz: float  # noise events per second and pixel


def _noise(span: Span, size: tuple[int, int]) -> _Noise:
    """Return the noise while the first frame is still."""
    time = playback.SETTLE // 2
    events = span.recording.read(max(span.start - time, 0), span.start)
    counts = histogram(events, max(span.start - time, 0), 1, time + 1)[0]
    seconds = max(min(time, span.start), 1) / MICROSECONDS
    return _Noise(counts / seconds * BIN / MICROSECONDS, len(events) / seconds / (size[0] * size[1]))


def _counts(recording: Recording, start: int, stop: int, bins: int) -> tuple[np.ndarray, int]:
    """Return the numbers of events per time bin and cell, [bins, cells], and the longest time (µs) without events."""
    parts, last, silence = [], start, 0
    for first in range(0, bins, 20):
        begin, count = start + first * BIN, min(20, bins - first)
        events = recording.read(begin, min(begin + count * BIN, stop))
        parts.append(histogram(events, begin, count, BIN))
        if len(events):
            silence = max(silence, int(np.diff(events.t, prepend=last).max()))
            last = int(events.t[-1])
    return np.concatenate(parts), max(silence, stop - last)


def _compared(found: np.ndarray, due: np.ndarray, noise: np.ndarray) -> tuple[float | None, float, float, float]:
    """Compare recorded with expected events [bins, cells]; return `scale`, `gap`, `hidden` and `stray` of `Content`."""
    seconds = len(found) * BIN / MICROSECONDS
    second = min(MICROSECONDS // BIN, len(due))
    busiest = np.convolve(due.sum(1), np.ones(second), "valid").max()
    if busiest < FEWEST * min(seconds, 1.0):
        # the video should cause hardly any events, so events beyond noise count as stray
        return None, 0.0, 0.0, _stray(found, np.zeros_like(due), noise)
    in_time, found_in_time = due.sum(1), found.sum(1) - noise.sum()
    busy = in_time >= 0.25 * in_time.max()
    # each bin is added to the next, because a screen takes most of a refresh to change, and pixels take longer
    scale = max(float(np.median(_with_next(found_in_time)[busy] / _with_next(in_time)[busy])), 0.0)
    # the ratio over the entire video counts, too, because events of half of the time may be missing
    level = max(scale, float(found_in_time.sum() / in_time.sum()), 0.01)
    around = np.pad(in_time, 1, mode="edge")
    surely = level * np.minimum(np.minimum(around[:-2], around[1:-1]), around[2:])
    enough = np.maximum(COUNTED, 5 * np.sqrt(noise.sum()))
    gap = _longest((surely >= enough) & (found_in_time < ABSENT * surely)) * BIN / 1e3
    there, places = level * due.sum(0), found.sum(0) - len(found) * noise
    sure = there >= np.maximum(COUNTED, 5 * np.sqrt(len(found) * noise))
    hidden = float(there[sure & (places < ABSENT * there)].sum() / max(there[sure].sum(), 1))
    return scale, gap, hidden, _stray(found, level * due, noise)


def _with_next(values: np.ndarray) -> np.ndarray:
    """Return the sum of each value and the next one."""
    paired: np.ndarray = values + np.append(values[1:], 0)
    return paired


def _stray(found: np.ndarray, due: np.ndarray, noise: np.ndarray) -> float:
    """Return the fraction of events in excess of expected events and noise, per cell and quarter of a second."""
    blocks = np.arange(0, len(found), BLOCK)
    seen, expected = (np.add.reduceat(counts, blocks, 0) for counts in (found, due))
    still = np.diff(np.append(blocks, len(found)))[:, None] * noise
    busy = expected >= COUNTED
    if busy.any():
        # constant events with another cause would raise the expected number
        expected *= min(max(float(np.median((seen - still)[busy] / expected[busy])), ABSENT), 1.0)
    beyond = seen - 3 * expected - still - 5 * np.sqrt(expected + still) - 20
    return float(np.maximum(beyond, 0).sum()) / max(float(found.sum()), COUNTED)


def _longest(flags: np.ndarray) -> int:
    """Return the length of the longest run of True."""
    ends = np.flatnonzero(np.diff(np.concatenate(([0], flags, [0]))))
    return int((ends[1::2] - ends[::2]).max(initial=0))
