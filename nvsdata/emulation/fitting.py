"""Estimation of the settings of `DVS` from frames and events that a real sensor recorded of one scene."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from nvsdata.data.events import Events
from nvsdata.data.recording import Recording
from nvsdata.emulation.dvs import DVS
from nvsdata.emulation.imperfections import AT_WHITE
from nvsdata.emulation.state import brightness
from nvsdata.emulation.thresholds import FEWEST, check_noise, fit_thresholds, match_thresholds, polarity_counts
from nvsdata.video.frames import VideoFrame, VideoInput, frames_of
from nvsdata.video.upsample import upsample_frames

DARKS = (1.0, 2.0, 3.0, 5.0, 8.0, 12.0, 20.0, 30.0, 45.0)  # gray levels
DELAYS = range(-10_000, 20_001, 1_000)  # µs
FOLLOWED = 0.1  # least correlation of polarities with changes of light for events that follow the frames
CALM = 0.05  # change of ln(q + 3) up to which light counts as constant
QUIET = 100.0  # pixels times seconds of constant light that an estimate of noise needs
RAREST = 0.001  # fraction of the intervals within pixels that may be shorter than the refractory period
SOONER = 2  # some emulated pixels must fire again this many times sooner than the sensor's
SHARP = 1.25  # times that period: ten times as many intervals are shorter if it is a sharp limit
REPEATED = 1_000  # intervals within pixels that an estimate of the refractory period needs
PER_PIXEL = 10  # events that an estimate of a pixel's own threshold needs


@dataclass(frozen=True)
class Fit:
    """Result of `fit`.

    Args:
        settings: The emulator.
        delay: Time in µs by which events follow the changes between frames: the sensor's own delay, and the time in
            which light reaches a threshold.
        correlation: Correlation of the numbers of events per pixel, emulated and real.
        thresholds: Thresholds of each pixel, OFF and ON, float64 [2, H, W]; NaN for pixels with too few events.
        unidentified: Settings that couldn't be estimated and stay as they were, with the reason.

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

    The numbers of ON and OFF events determine the thresholds, by emulation. The places of events determine `dark`.
    Events under constant light determine noise and leak, and the shortest intervals within pixels the refractory
    period.

    Args:
        frames: Frames, as `DVS.stream` takes them.
        events: Events of the same sensor and scene.
        times: Times of the frames in µs of the events' clock (default: the frames' own).
        delay: Time in µs by which events follow the frames (default: estimated, between -10 and 20 ms). If it is given,
            a still scene shows leak and noise.
        base: Settings that a pair doesn't show, such as `upsample` and `mismatch` (default: `DVS()`).
        noise: Whether leak and noise are estimated; if not, those of `base` stay, and thresholds explain all other
            events.

    Returns:
        A `Fit`. Its settings give the sensor's numbers of OFF and ON events to within 5%, unless `unidentified` has a
        reason why not.

    Raises:
        ValueError: There are fewer than 3 frames, frames and sensor differ in size, frames and events have no time in
            common, nothing moves, events don't follow the light, or neither threshold can be determined and leak and
            noise don't give as many events as the sensor.

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
    known, delay = delay is not None, pair.delay() if delay is None else delay
    real = pair.during(delay)
    settings, other = base or DVS(), np.zeros(2)
    unidentified: dict[str, str] = {}
    if noise:
        settings, other = _noise(settings, pair, real, unidentified)
    # once for all trials
    frames = list(upsample_frames(iter(pair.frames), settings.upsample))
    needed = polarity_counts(real) - other
    trial = replace(settings, upsample="none", leak=0.0, noise_rate=0.0, hot_pixels=0.0)
    free = needed >= FEWEST
    candidates = [match_thresholds(replace(trial, dark=dark), frames, needed, free) for dark in DARKS]
    # they give the same numbers of events, and differ by where these are
    best = max(candidates, key=lambda one: correlation(one.emulate(frames), real))
    settings = _refractory(settings, best.emulate(frames), real, unidentified)
    # leak, noise and blindness change how many events a threshold gives
    given = replace(settings, upsample="none")
    best = fit_thresholds(
        replace(given, off=best.off, on=best.on, dark=best.dark), given, frames, real, needed, unidentified
    )
    found = best.emulate(frames)
    if {"off", "on"} <= unidentified.keys():
        check_noise(given.emulate(frames), real, unidentified)
    elif known:
        pair.check_followed(delay)
    names = [name for name in ("off", "on", "dark") if name not in unidentified]
    settings = replace(settings, **{name: getattr(best, name) for name in names})
    return Fit(settings, delay, correlation(found, real), _each(best, pair, real), unidentified)


class _AlignedPair:
    """Frames, and the events around them; times count from the first frame."""

    def __init__(self, frames: list[VideoFrame], events: Events | Recording, delay: int) -> None:
        if len(frames) < 3:
            raise ValueError(f"{len(frames)} frames: a fit needs at least 3")
        height, width = frames[0].pixels.shape[:2]
        if (width, height) != events.sensor_size:
            raise ValueError(f"frames are {width}x{height}, events of {'x'.join(map(str, events.sensor_size))}")
        start, stop = frames[0].time, frames[-1].time
        check_common((start, stop), events)
        cut = events.read if isinstance(events, Recording) else events.window
        around = cut(start + min(DELAYS[0], delay), stop + max(DELAYS[-1], delay) + 1)
        columns = around.columns
        self.events = Events.trusted(columns._replace(t=columns.t - start), events.sensor_size, 0, stop - start)
        self.frames = [frame._replace(time=frame.time - start) for frame in frames]
        self.gray = np.stack([brightness(frame) for frame in frames])
        self.light = np.log(self.gray + 3)

    def during(self, delay: int) -> Events:
        """Return the events that belong to the frames, at times without the delay."""
        last = self.frames[-1].time
        inside = slice(*np.searchsorted(self.events.t, (delay, last + delay)))
        columns = self.events.columns.take(inside)
        return Events.trusted(columns._replace(t=columns.t - delay), self.events.sensor_size, 0, last)

    def delay(self) -> int:
        """Return the delay at which polarities between frames are best correlated with the change of light."""
        if (np.ptp(self.light, axis=0) < CALM).all():
            why = f"light changes by less than {CALM:.0%} at each pixel, and only motion shows thresholds and the delay"
            raise ValueError(f"nothing moves in these frames: {why}; delay=0 looks for leak and noise alone")
        found = [self._follows(delay) for delay in DELAYS]
        if max(found) < FOLLOWED:
            raise _unfollowed(f"{max(found):.2f} at best")
        best = int(np.argmax(found))
        if not 0 < best < len(found) - 1:
            return DELAYS[best]
        # the vertex of the parabola through the best delay and its neighbors
        before, here, after = found[best - 1 : best + 2]
        bend = before - 2 * here + after
        return DELAYS[best] + round(DELAYS.step * 0.5 * (before - after) / bend) if bend else DELAYS[best]

    def check_followed(self, delay: int) -> None:
        """Raise ValueError unless polarities follow the light at a delay, significantly if events are few."""
        found = self._follows(delay)
        if found < min(FOLLOWED, 5 / math.sqrt(self.light[1:].size)):
            raise _unfollowed(f"{found:.2f} with a delay of {delay} µs")

    def _follows(self, delay: int) -> float:
        """Return the correlation of summed polarities with the change of light, mean over the frames."""
        found = []
        for k, (a, b) in enumerate(pairwise(frame.time + delay for frame in self.frames)):
            some = slice(*np.searchsorted(self.events.t, (a, b)))
            signs = 2.0 * self.events.p[some] - 1
            sums = np.bincount(pixel_index(self.events)[some], signs, self.light[0].size)
            found.append(_correlated(sums, (self.light[k + 1] - self.light[k]).ravel()))
        return float(np.mean(found))


def check_common(span: tuple[int, int], events: Events | Recording) -> None:
    """Raise ValueError for events without time in common with frames of this span (µs)."""
    start, stop = span
    if events.end <= start or events.start >= stop:
        raise ValueError(
            f"no time in common: frames from {start} to {stop} µs, events from {events.start} to {events.end}"
        )


def _unfollowed(correlation: str) -> ValueError:
    return ValueError(
        f"events don't follow the frames: their correlation is {correlation}; does anything move, and is it one clock?"
    )


def _noise(settings: DVS, pair: _AlignedPair, real: Events, unidentified: dict[str, str]) -> tuple[DVS, np.ndarray]:
    """Return settings with leak and noise as under constant light, and their numbers of OFF and ON events."""
    calm = np.ptp(pair.light, axis=0) < CALM
    # the neighborhood of a moving edge isn't calm, either
    for axis in (0, 1):
        calm = calm & np.roll(calm, 1, axis) & np.roll(calm, -1, axis)
    seconds = pair.frames[-1].time / 1e6
    if calm.sum() * seconds < QUIET:
        reason = f"light is constant for {calm.sum() * seconds:.0f} pixels times seconds, {QUIET:.0f} are needed"
        unidentified |= {"leak": reason, "noise_rate": reason}
        return settings, np.zeros(2)
    inside = calm.ravel()[pixel_index(real)]
    off, on = np.bincount(real.p[inside], minlength=2)[:2].tolist()
    # significantly more ON than OFF events are leak
    more = on - off if on - off > 3 * math.sqrt(on + off) else 0
    leak, common = more / (calm.sum() * seconds), (on + off - more) / (calm.sum() * seconds)
    gray = np.exp(pair.light.mean(axis=0)) - 3
    share = 1 - (1 - AT_WHITE) * gray / 255
    rate = common / float(share[calm].mean())
    total = np.array([rate * share.sum() / 2, rate * share.sum() / 2 + leak * share.size]) * seconds
    return replace(settings, leak=round(float(leak), 4), noise_rate=round(float(rate), 4)), total


def _refractory(settings: DVS, found: Events, real: Events, unidentified: dict[str, str]) -> DVS:
    """Return settings with the refractory period.

    Real pixels hardly ever fire again within this time, though emulated ones, in `found`, do.
    """
    gaps, ours = intervals(real), intervals(found)
    if min(gaps.size, ours.size) < REPEATED:
        unidentified["refractory"] = f"{min(gaps.size, ours.size)} intervals within pixels, {REPEATED} are needed"
        return settings
    least, few = np.quantile(gaps, (RAREST, 10 * RAREST)).tolist()
    # a refractory period cuts intervals off; without it, short ones get rarer gradually, or the scene has none
    if few > SHARP * least or np.quantile(ours, RAREST) > least / SOONER:
        unidentified["refractory"] = "pixels don't fire again soon enough to show it"
        return settings
    return replace(settings, refractory=int(least))


def intervals(events: Events) -> np.ndarray:
    """Return the intervals (µs) between successive events of each pixel."""
    order = np.lexsort((events.t, pixel_index(events)))
    return np.asarray(np.diff(events.t[order])[np.diff(pixel_index(events)[order]) == 0])


def _each(settings: DVS, pair: _AlignedPair, real: Events) -> np.ndarray:
    """Return each pixel's thresholds: the total rise or fall of its light per ON or OFF event."""
    steps = np.diff(np.log(pair.gray + settings.dark), axis=0)
    moved = np.stack((np.maximum(-steps, 0).sum(axis=0), np.maximum(steps, 0).sum(axis=0)))
    counts = np.stack([np.bincount(pixel_index(real)[real.p == p], minlength=steps[0].size) for p in (0, 1)])
    counts = counts.reshape(moved.shape)
    return np.where((counts >= PER_PIXEL) & (moved > 0), moved / np.maximum(counts, 1), np.nan)


def pixel_index(events: Events) -> np.ndarray:
    """Return the index y * width + x of each event's pixel."""
    return events.y.astype(np.int64) * events.sensor_size[0] + events.x


def correlation(ours: Events, real: Events) -> float:
    """Return the correlation of the numbers of events per pixel; 0 if they are constant on one side."""
    size = real.sensor_size[0] * real.sensor_size[1]
    return _correlated(*(np.bincount(pixel_index(events), minlength=size).astype(float) for events in (ours, real)))


def _correlated(a: np.ndarray, b: np.ndarray) -> float:
    """Return Pearson's correlation coefficient; 0 if either is constant."""
    a, b = a - a.mean(), b - b.mean()
    scale = float(np.sqrt((a * a).sum() * (b * b).sum()))
    return float((a * b).sum()) / scale if scale else 0.0
