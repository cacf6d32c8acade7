"""The settings of `DVS` that a real sensor shows, from its frames and events of one scene."""

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
from nvsdata.emulation.run import brightness
from nvsdata.emulation.thresholds import FEWEST, check_noise, counts_of, matched, settled
from nvsdata.video.frames import Frame, Video, frames_of
from nvsdata.video.upsample import upsampled

DARKS = (1.0, 2.0, 3.0, 5.0, 8.0, 12.0, 20.0, 30.0, 45.0)  # gray levels
DELAYS = range(-10_000, 20_001, 1_000)  # µs
FOLLOWED = 0.1  # correlation of polarities with changes of light from which events follow the frames
CALM = 0.05  # change of ln(q + 3) up to which light counts as constant
QUIET = 100.0  # pixels times seconds of constant light from which noise can be told
RAREST = 0.001  # share of the intervals within pixels that may be shorter than the refractory time
SOONER = 2  # times as soon as the sensor's at least some emulated pixels must fire again
SHARP = 1.25  # times it, below which ten times as many are if it's a limit
REPEATED = 1_000  # intervals within pixels from which a refractory time can be told
PER_PIXEL = 10  # events of a pixel from which it has thresholds of its own


@dataclass(frozen=True)
class Fit:
    """What `fit` found.

    - `settings`: the emulator
    - `delay`: µs by which events follow the changes between frames: the sensor's own, and the time in which light
      reaches a threshold
    - `correlation`: of the numbers of events per pixel, emulated and real
    - `thresholds`: each pixel's own, OFF and ON, float64 [2, H, W]; NaN where it has too few events
    - `untold`: settings that the pair can't tell, which stay as they were, and why
    """

    settings: DVS
    delay: int
    correlation: float
    thresholds: np.ndarray
    untold: dict[str, str] = field(default_factory=dict)


def fit(
    frames: Video,
    events: Events | Recording,
    *,
    times: Iterable[int] | None = None,
    delay: int | None = None,
    base: DVS | None = None,
    noise: bool = True,
) -> Fit:
    """Estimate thresholds, `dark`, refractory time, leak and noise of a sensor that gave frames and events together.

    The numbers of ON and OFF events set the thresholds, by emulation; where events are sets `dark`; events where light
    is constant set noise and leak; and the shortest intervals within pixels the refractory time.

    - `frames`: as `DVS.stream` takes them
    - `events`: of the same sensor
    - `times`: the frames' times in µs of the events' clock (default: those that the frames have)
    - `delay`: µs by which events follow the frames' times (default: found, from -10 to 20 ms). If it's given, a still
      scene shows leak and noise
    - `noise`: whether leak and noise are looked for; if not, those of `base` stay, and thresholds explain all other
      events (default True)
    - `base`: settings that can't be told from a pair, such as `upsample` and `mismatch` (default: `DVS()`)

    The settings give the numbers of OFF and ON events of the sensor to within 5%, where `untold` has no reason why not.

    Raises ValueError for fewer than 3 frames, frames of another size than the sensor's, events and frames that have
    no time in common (with both spans), scenes in which nothing moves, pairs in which no events follow the light, and
    those that determine neither threshold, unless leak and noise give as many events as the sensor did.
    """
    pair = _Pair(list(frames_of(frames, times=times, color=False)), events, delay or 0)
    known, delay = delay is not None, pair.delay() if delay is None else delay
    real = pair.during(delay)
    settings, other = base or DVS(), np.zeros(2)
    untold: dict[str, str] = {}
    if noise:
        settings, other = _noise(settings, pair, real, untold)
    # once for all trials
    frames = list(upsampled(iter(pair.frames), settings.upsample))
    needed = counts_of(real) - other
    trial = replace(settings, upsample="none", leak=0.0, noise_rate=0.0, hot_pixels=0.0)
    free = needed >= FEWEST
    candidates = [matched(replace(trial, dark=dark), frames, needed, free) for dark in DARKS]
    # they give the same numbers of events, and differ by where these are
    best = max(candidates, key=lambda one: correlation(one.emulate(frames), real))
    settings = _refractory(settings, best.emulate(frames), real, untold)
    # leak, noise and blindness change how many events a threshold gives
    given = replace(settings, upsample="none")
    best = settled(replace(given, off=best.off, on=best.on, dark=best.dark), given, frames, real, needed, untold)
    found = best.emulate(frames)
    if {"off", "on"} <= untold.keys():
        check_noise(given.emulate(frames), real, untold)
    elif known:
        pair.check_followed(delay)
    names = [name for name in ("off", "on", "dark") if name not in untold]
    settings = replace(settings, **{name: getattr(best, name) for name in names})
    return Fit(settings, delay, correlation(found, real), _each(best, pair, real), untold)


class _Pair:
    """Frames, and the events of the time around them; times count from the first frame."""

    def __init__(self, frames: list[Frame], events: Events | Recording, delay: int) -> None:
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
        """The events that belong to the frames, as if there were no delay."""
        last = self.frames[-1].time
        inside = slice(*np.searchsorted(self.events.t, (delay, last + delay)))
        columns = self.events.columns.take(inside)
        return Events.trusted(columns._replace(t=columns.t - delay), self.events.sensor_size, 0, last)

    def delay(self) -> int:
        """At which delay the polarities between frames follow the change of light best."""
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
        """ValueError unless the polarities follow the light at a delay, by more than chance makes of few events."""
        found = self._follows(delay)
        if found < min(FOLLOWED, 5 / math.sqrt(self.light[1:].size)):
            raise _unfollowed(f"{found:.2f} with a delay of {delay} µs")

    def _follows(self, delay: int) -> float:
        """Correlation of summed polarities with the change of light, mean over the frames."""
        found = []
        for k, (a, b) in enumerate(pairwise(frame.time + delay for frame in self.frames)):
            some = slice(*np.searchsorted(self.events.t, (a, b)))
            signs = 2.0 * self.events.p[some] - 1
            sums = np.bincount(places(self.events)[some], signs, self.light[0].size)
            found.append(_correlated(sums, (self.light[k + 1] - self.light[k]).ravel()))
        return float(np.mean(found))


def check_common(span: tuple[int, int], events: Events | Recording) -> None:
    """ValueError for events without time in common with frames of this span (µs)."""
    start, stop = span
    if events.end <= start or events.start >= stop:
        raise ValueError(
            f"no time in common: frames from {start} to {stop} µs, events from {events.start} to {events.end}"
        )


def _unfollowed(correlation: str) -> ValueError:
    return ValueError(
        f"events don't follow the frames: their correlation is {correlation}; does anything move, and is it one clock?"
    )


def _noise(settings: DVS, pair: _Pair, real: Events, untold: dict[str, str]) -> tuple[DVS, np.ndarray]:
    """Settings with leak and noise as where light is constant; and how many OFF and ON events are these over all."""
    calm = np.ptp(pair.light, axis=0) < CALM
    # a moving edge is never far from where it was seen
    for axis in (0, 1):
        calm = calm & np.roll(calm, 1, axis) & np.roll(calm, -1, axis)
    seconds = pair.frames[-1].time / 1e6
    if calm.sum() * seconds < QUIET:
        reason = f"light is constant for {calm.sum() * seconds:.0f} pixels times seconds, {QUIET:.0f} are needed"
        untold |= {"leak": reason, "noise_rate": reason}
        return settings, np.zeros(2)
    inside = calm.ravel()[places(real)]
    off, on = np.bincount(real.p[inside], minlength=2)[:2].tolist()
    # more ON events than chance makes of equal rates
    more = on - off if on - off > 3 * math.sqrt(on + off) else 0
    leak, common = more / (calm.sum() * seconds), (on + off - more) / (calm.sum() * seconds)
    gray = np.exp(pair.light.mean(axis=0)) - 3
    share = 1 - (1 - AT_WHITE) * gray / 255
    rate = common / float(share[calm].mean())
    total = np.array([rate * share.sum() / 2, rate * share.sum() / 2 + leak * share.size]) * seconds
    return replace(settings, leak=round(float(leak), 4), noise_rate=round(float(rate), 4)), total


def _refractory(settings: DVS, found: Events, real: Events, untold: dict[str, str]) -> DVS:
    """Settings with the time below which pixels hardly ever fire again, though emulated ones, in `found`, do."""
    gaps, ours = intervals(real), intervals(found)
    if min(gaps.size, ours.size) < REPEATED:
        untold["refractory"] = f"{min(gaps.size, ours.size)} intervals within pixels, {REPEATED} are needed"
        return settings
    least, few = np.quantile(gaps, (RAREST, 10 * RAREST)).tolist()
    # blindness cuts off what would go on; without it, short intervals get rarer by and by, or the scene has none
    if few > SHARP * least or np.quantile(ours, RAREST) > least / SOONER:
        untold["refractory"] = "pixels don't fire again so soon that they could be blind"
        return settings
    return replace(settings, refractory=int(least))


def intervals(events: Events) -> np.ndarray:
    """Intervals (µs) between events of a pixel."""
    order = np.lexsort((events.t, places(events)))
    return np.asarray(np.diff(events.t[order])[np.diff(places(events)[order]) == 0])


def _each(settings: DVS, pair: _Pair, real: Events) -> np.ndarray:
    """Thresholds of pixels: by how much their light rose, or fell, in all, per ON, or OFF, event."""
    steps = np.diff(np.log(pair.gray + settings.dark), axis=0)
    moved = np.stack((np.maximum(-steps, 0).sum(axis=0), np.maximum(steps, 0).sum(axis=0)))
    counts = np.stack([np.bincount(places(real)[real.p == p], minlength=steps[0].size) for p in (0, 1)])
    counts = counts.reshape(moved.shape)
    return np.where((counts >= PER_PIXEL) & (moved > 0), moved / np.maximum(counts, 1), np.nan)


def places(events: Events) -> np.ndarray:
    """The number of each event's pixel, row by row."""
    return events.y.astype(np.int64) * events.sensor_size[0] + events.x


def correlation(ours: Events, real: Events) -> float:
    """Of the numbers of events per pixel; 0 where one side has as many everywhere."""
    size = real.sensor_size[0] * real.sensor_size[1]
    return _correlated(*(np.bincount(places(events), minlength=size).astype(float) for events in (ours, real)))


def _correlated(a: np.ndarray, b: np.ndarray) -> float:
    """Pearson's coefficient; 0 where one of them is constant."""
    a, b = a - a.mean(), b - b.mean()
    scale = float(np.sqrt((a * a).sum() * (b * b).sum()))
    return float((a * b).sum()) / scale if scale else 0.0
