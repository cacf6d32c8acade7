"""Estimation of the settings of `DVS` from frames and events that a real sensor recorded of one scene."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from nvsdata.data.events import Events
from nvsdata.data.recording import Recording
from nvsdata.emulation.correlation import BlockBootstrap, correlation, count_images, find_peak, pearson, pixel_index
from nvsdata.emulation.dvs import DVS
from nvsdata.emulation.imperfection_fit import CALM, NO_EVENTS, fit_noise, fit_refractory, without_harmful_leak
from nvsdata.emulation.state import brightness
from nvsdata.emulation.thresholds import FEWEST, NAMES, check_counts, fit_thresholds, match_dark
from nvsdata.video.frames import VideoFrame, VideoInput, frames_of
from nvsdata.video.upsample import upsample_frames

DELAYS = range(-10_000, 20_001, 1_000)  # µs; delays that are tried first
LATEST = 100_000  # µs; delays of up to this magnitude are tried if the best is at an end of `DELAYS`
FOLLOWED = 0.1  # smallest correlation of polarities with changes of light if events follow the frames
ALONE = "delay=0 estimates leak and noise only"
ALIKE = 0.5  # correlation of adjacent pixels' changes of light below which the changes are noise of the frames
PER_PIXEL = 10  # events that an estimate of a pixel's own threshold needs


@dataclass(frozen=True)
class Fit:
    """Result of `fit`.

    Args:
        settings: The fitted emulator.
        delay: Time in µs by which events follow the changes between frames: the delay of the sensor, plus the time
            until a change of light reaches a threshold.
        correlation: Correlation between the emulated and the real numbers of events per pixel.
        thresholds: Thresholds of each pixel, OFF and ON, float64 [2, H, W]; NaN for pixels with too few events.
        unidentified: Settings that couldn't be estimated and keep the values of `base`, each with the reason. A `dark`
            or delay at the limit of the search is only a bound, and is listed, too. So is the threshold of a polarity
            whose numbers of emulated and real events differ by more than 5% plus four standard deviations of Poisson
            counts.
        intervals: 95% confidence intervals of `dark`, the thresholds and the delay, if they were estimated. They are
            percentiles of a bootstrap over 64 blocks of pixels: `dark`, thresholds and delay are estimated for each
            sample of blocks. The intervals include the effects of noise, mismatch and the choice of pixels, but no
            errors that all blocks share, such as those of upsampling or blurred frames.

    Example:
        >>> import numpy as np
        >>> from nvsdata.emulation import DVS, Fit
        >>> found = Fit(DVS(on=0.2), delay=1_500, correlation=0.9, thresholds=np.zeros((2, 180, 240)))
        >>> found.settings.on, found.delay
        (0.2, 1500)
    """

    settings: DVS
    delay: int
    correlation: float
    thresholds: np.ndarray
    unidentified: dict[str, str] = field(default_factory=dict)
    intervals: dict[str, tuple[float, float]] = field(default_factory=dict)


def fit(
    frames: VideoInput,
    events: Events | Recording,
    *,
    times: Iterable[int] | None = None,
    delay: int | None = None,
    base: DVS | None = None,
    noise: bool = True,
) -> Fit:
    """Estimate the thresholds, `dark`, refractory period, leak and noise of a sensor from frames and events.

    Thresholds are chosen so that emulation returns the sensor's numbers of ON and OFF events. `dark` is chosen so that
    emulated events are at pixels of the same mean brightness: the higher `dark`, the fewer events at dark pixels.
    Events under constant light determine noise and leak, and the shortest intervals between events of a pixel
    determine the refractory period.

    Args:
        frames: Frames, as `DVS.stream` takes them.
        events: Events of the same sensor and scene.
        times: Times of the frames in µs, by the clock of the events (default: the frames' own times).
        delay: Time in µs by which events follow the frames (default: estimated; from -10 to 20 ms first, then up to
            100 ms in either direction). With a given delay, leak and noise can be estimated from a still scene.
        base: Emulator with the settings that aren't estimated, such as `upsample` and `mismatch` (default: `DVS()`).
        noise: Estimate leak and noise. If False, those of `base` are kept.

    Returns:
        A `Fit`. With its settings, the numbers of OFF and ON events are within 5% of the sensor's, apart from chance,
        or else `unidentified` has the reason.

    Raises:
        ValueError: There are fewer than 3 frames, frames and sensor differ in size, or their times don't overlap.
            Nothing moves and `delay` isn't given. Events don't follow the light. Neither threshold can be estimated,
            and leak and noise don't explain the number of events.

    Example:
        >>> import numpy as np
        >>> x = np.arange(60 * 80).reshape(60, 80)
        >>> frames = [(100 + 60 * np.sin((x + 2 * n) / 5)).astype(np.uint8) for n in range(12)]
        >>> events = DVS(on=0.2, off=0.3).emulate(frames, fps=25)
        >>> found = fit(frames, events, times=range(0, 480_000, 40_000)).settings
        >>> f"{found.on:.2f} {found.off:.2f}"
        '0.20 0.30'
    """
    pair = _AlignedPair(list(frames_of(frames, times=times, color=False)), events, delay or 0)
    base = base or DVS()
    unidentified: dict[str, str] = {}
    intervals: dict[str, tuple[float, float]] = {}
    known, still = delay is not None, delay is not None and noise and pair.still(delay)
    if delay is None:
        delay, intervals["delay"] = pair.delay()
        if abs(delay) >= LATEST:
            unidentified["delay"] = f"events follow the frames best at {delay} µs, where the search ends"
    real = pair.during(delay)
    settings, other = fit_noise(base, pair.light, real, still, unidentified) if noise else (base, NO_EVENTS)
    if still:
        unidentified |= dict.fromkeys(NAMES, "nothing moves, but thresholds need motion")
    # frames are upsampled once for all trials
    frames = list(upsample_frames(iter(pair.frames), base.upsample))
    moved = count_images(real) - other
    needed = moved.sum(axis=(1, 2))
    free = (needed >= FEWEST) & (not still)
    best, at_end = replace(base, upsample="none", leak=0.0, noise_rate=0.0, hot_pixels=0.0), False
    if free.any():
        best, found, at_end = match_dark(best, frames, pair.light.mean(axis=0), moved, free)
        intervals |= found
        settings = without_harmful_leak(settings, base, best, frames, real, free, unidentified)
    settings = fit_refractory(settings, best.emulate(frames), real, unidentified)
    # leak, noise and the refractory period change the number of events at a threshold
    given = replace(settings, upsample="none")
    start = replace(given, off=best.off, on=best.on, dark=best.dark)
    matched = fit_thresholds(start, given, frames, real, needed, unidentified)
    intervals = _matched_intervals(intervals, best, matched, unidentified)
    if at_end and "dark" in intervals:
        unidentified["dark"] = f"{matched.dark:g} gray levels fit best, where the search ends"
    emulated = matched.emulate(frames)
    check_counts(emulated, real, unidentified, still)
    if known and not still:
        pair.check_followed(delay)
    settings = replace(matched, upsample=base.upsample)
    return Fit(settings, delay, correlation(emulated, real), _each(matched, pair, real), unidentified, intervals)


class _AlignedPair:
    """Frames, and the events from shortly before to shortly after them; times (µs) are relative to the first."""

    def __init__(self, frames: list[VideoFrame], events: Events | Recording, delay: int) -> None:
        if len(frames) < 3:
            raise ValueError(f"{len(frames)} frames: a fit needs at least 3")
        height, width = frames[0].pixels.shape[:2]
        if (width, height) != events.sensor_size:
            raise ValueError(f"frames are {width}x{height}, events of {'x'.join(map(str, events.sensor_size))}")
        start, stop = frames[0].time, frames[-1].time
        check_common((start, stop), events)
        cut = events.read if isinstance(events, Recording) else events.window
        around = cut(start + min(-LATEST, delay), stop + max(LATEST, delay) + 1)
        columns = around.columns
        self.events = Events.trusted(columns._replace(t=columns.t - start), events.sensor_size, 0, stop - start)
        self._pixels = pixel_index(self.events)
        self.frames = [frame._replace(time=frame.time - start) for frame in frames]
        self.gray = np.stack([brightness(frame) for frame in frames])
        self.light = np.log(self.gray + 3)
        self._blocks = BlockBootstrap((height, width))

    def during(self, delay: int) -> Events:
        """Return the events that belong to the frames; the delay (µs) is subtracted from their times."""
        last = self.frames[-1].time
        inside = slice(*np.searchsorted(self.events.t, (delay, last + delay)))
        columns = self.events.columns.take(inside)
        return Events.trusted(columns._replace(t=columns.t - delay), self.events.sensor_size, 0, last)

    def delay(self) -> tuple[int, tuple[float, float]]:
        """Return the delay (µs) at which polarities follow the change of light best, and its confidence interval."""
        if (np.ptp(self.light, axis=0) < CALM).all():
            why = f"light changes by less than {CALM:.0%} at each pixel, but thresholds and delay need motion"
            raise ValueError(f"nothing moves in these frames: {why}; {ALONE}")
        tried = {delay: self._follows(delay) for delay in DELAYS}
        while max(tried, key=lambda delay: tried[delay][0]) == max(tried) < LATEST:
            tried[max(tried) + DELAYS.step] = self._follows(max(tried) + DELAYS.step)
        while max(tried, key=lambda delay: tried[delay][0]) == min(tried) > -LATEST:
            tried[min(tried) - DELAYS.step] = self._follows(min(tried) - DELAYS.step)
        found = np.stack([tried[delay] for delay in sorted(tried)])
        if found[:, 0].max() < FOLLOWED:
            raise self._unfollowed(f"{found[:, 0].max():.2f} at best")
        peak = find_peak(np.array(sorted(tried), float), found)
        return round(peak.places[0]), (peak.low, peak.high)

    def still(self, delay: int) -> bool:
        """Return True if the light changes only by noise of the frames, and events at this delay don't follow it."""
        return self._noise_only() and self._follows(delay)[0] < FOLLOWED

    def check_followed(self, delay: int) -> None:
        """Raise ValueError if polarities at this delay hardly correlate with changes of the light.

        With many pixels, a small correlation suffices if it is significant.
        """
        found = self._follows(delay)[0]
        if found < min(FOLLOWED, 5 / math.sqrt(self.light[1:].size)):
            raise self._unfollowed(f"{found:.2f} with a delay of {delay} µs")

    def _noise_only(self) -> bool:
        """Return True if light changes independently at adjacent pixels; motion would change them similarly."""
        steps = np.diff(self.light, axis=0)
        steps = steps - steps.mean(axis=(1, 2), keepdims=True)
        rows = pearson(steps[:, 1:], steps[:, :-1])
        return min(rows, pearson(steps[:, :, 1:], steps[:, :, :-1])) < ALIKE

    def _follows(self, delay: int) -> np.ndarray:
        """Return the correlation of summed polarities with the change of light, averaged over frames, [samples]."""
        found = []
        for k, (a, b) in enumerate(pairwise(frame.time + delay for frame in self.frames)):
            some = slice(*np.searchsorted(self.events.t, (a, b)))
            signs = 2.0 * self.events.p[some] - 1
            sums = np.bincount(self._pixels[some], signs, self.light[0].size).reshape(self.light[0].shape)
            found.append(self._blocks.correlation(sums, self.light[k + 1] - self.light[k]))
        return np.asarray(np.mean(found, axis=0))

    def _unfollowed(self, correlation: str) -> ValueError:
        hint = f"; if nothing moves, {ALONE}" if self._noise_only() else ""
        return ValueError(
            f"events don't follow the frames: their correlation is {correlation}; check that something moves, and that "
            f"both have the same clock{hint}"
        )


def check_common(span: tuple[int, int], events: Events | Recording) -> None:
    """Raise ValueError if the times of events don't overlap with this span of the frames (µs)."""
    start, stop = span
    if events.end <= start or events.start >= stop:
        raise ValueError(
            f"no time in common: frames from {start} to {stop} µs, events from {events.start} to {events.end}"
        )


def _matched_intervals(
    intervals: dict[str, tuple[float, float]], best: DVS, matched: DVS, unidentified: dict[str, str]
) -> dict[str, tuple[float, float]]:
    """Return the intervals of identified settings and the delay; those of thresholds are scaled to `matched`."""
    kept = {name: ends for name, ends in intervals.items() if name not in unidentified or name == "delay"}
    for name in kept.keys() & {*NAMES}:
        scale = getattr(matched, name) / getattr(best, name)
        kept[name] = (kept[name][0] * scale, kept[name][1] * scale)
    return kept


def _each(settings: DVS, pair: _AlignedPair, real: Events) -> np.ndarray:
    """Return each pixel's OFF and ON threshold, [2, H, W]: the total fall or rise of ln(q + dark) per event."""
    steps = np.diff(np.log(pair.gray + settings.dark), axis=0)
    moved = np.stack((np.maximum(-steps, 0).sum(axis=0), np.maximum(steps, 0).sum(axis=0)))
    counts = count_images(real)
    return np.where((counts >= PER_PIXEL) & (moved > 0), moved / np.maximum(counts, 1), np.nan)
