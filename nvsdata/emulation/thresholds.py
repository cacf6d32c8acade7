"""Search for the thresholds, and for the `dark`, with which emulated events match those of a real sensor."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from nvsdata.data.events import Events
from nvsdata.emulation.correlation import BlockBootstrap, count_images, interval
from nvsdata.emulation.dvs import DVS
from nvsdata.video.frames import VideoFrame

LEAST, MOST = 0.01, 3.0  # range of thresholds
# differences of logarithms of event counts: below CLOSE the search ends, beyond FAR it has failed
CLOSE, FAR = 0.003, 0.05
ROUNDS = 25  # emulations of a search
NARROW, WIDE = 1e-4, 0.1  # widths of a logarithmic interval: below NARROW the interval is widened to WIDE again
FEWEST = 100  # events of a polarity that an estimate of its threshold needs
NAMES = ("off", "on")
DARKS = (1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0)  # gray levels that are tried first
DARKEST, BRIGHTEST = 0.1, 1_000.0  # limits of the search for `dark`
REFINED = 2  # further values of `dark`, each interpolated from those tried before
MIDDLE = 80.0  # typical gray level, by which thresholds are scaled from one `dark` to the next
STEP = 0.05  # step of a threshold's logarithm by which the slope of counts is measured


def polarity_counts(events: Events) -> np.ndarray:
    """Return the numbers of OFF and of ON events."""
    return np.bincount(events.p, minlength=2)[:2]


def match_thresholds(trial: DVS, frames: list[VideoFrame], wanted: np.ndarray, free: np.ndarray) -> tuple[DVS, Events]:
    """Search for thresholds that result in `wanted` numbers of events; return the best settings and their events.

    Args:
        trial: Settings to begin with.
        frames: Frames of the scene.
        wanted: Numbers of OFF and of ON events; the search ends if the logarithms of the emulated numbers
            differ from those of `wanted` by less than `CLOSE`.
        free: Mask of the thresholds that may change, OFF and ON.
    """
    brackets = _Bracket(), _Bracket()
    value = [math.log(trial.off), math.log(trial.on)]
    best, nearest = (trial, Events.empty((1, 1))), math.inf
    wanted = np.maximum(wanted, 1)
    for _ in range(ROUNDS):
        off, on = map(math.exp, value)
        trial = replace(trial, off=off if free[0] else trial.off, on=on if free[1] else trial.on)
        found = trial.emulate(frames)
        apart = np.where(free, np.log((polarity_counts(found) + 1) / (wanted + 1)), 0)
        if np.abs(apart).max() < nearest:
            best, nearest = (trial, found), float(np.abs(apart).max())
        before, value = value, [b.next(*at) for b, *at in zip(brackets, value, apart.tolist(), strict=True)]
        if nearest < CLOSE or value == before:
            break
    return best


class DarkFit(NamedTuple):
    """Result of `match_dark`.

    Args:
        settings: Settings with the thresholds and `dark`.
        intervals: 95% confidence intervals of `dark` and of the thresholds that are free.
        at_end: True if the best `dark` is a limit of the search.
    """

    settings: DVS
    intervals: dict[str, tuple[float, float]]
    at_end: bool


def match_dark(trial: DVS, frames: list[VideoFrame], light: np.ndarray, real: np.ndarray, free: np.ndarray) -> DarkFit:
    """Find the settings with as many events as the sensor, at pixels that are as bright on average.

    As `dark` rises, with thresholds matched at each value, emulated events move to brighter pixels. The result is the
    `dark` at which the mean logarithm of brightness at emulated events equals that at the sensor's events. Unlike the
    maximum of a correlation, this estimate isn't biased by noise, mismatch or upsampling, which change the numbers of
    events at random. For the intervals, `dark` and thresholds are estimated for each sample of a bootstrap over blocks
    of pixels; the intervals are percentiles of these estimates.

    Args:
        trial: Settings to begin with.
        frames: Frames of the scene.
        light: Logarithm of the mean brightness, [H, W].
        real: Numbers of OFF and of ON events of each pixel without those of leak and noise, [2, H, W].
        free: Mask of the thresholds that may change, OFF and ON.
    """
    profile = _Profile(trial, frames, light, real, free)
    for dark in DARKS:
        profile.add(dark)
    while (more := profile.beyond()) is not None:
        profile.add(more)
    for _ in range(REFINED):
        dark = float(f"{math.exp(profile.places()[0]):.3g}")
        profile.add(dark)
    return DarkFit(profile.tried[dark], profile.intervals(dark), not DARKEST < dark < BRIGHTEST)


class _Profile:
    """Values of `dark` that were tried, with their settings; parameters are those of `match_dark`."""

    def __init__(
        self, trial: DVS, frames: list[VideoFrame], light: np.ndarray, real: np.ndarray, free: np.ndarray
    ) -> None:
        self.trial, self.frames, self.free = trial, frames, free
        self.tried: dict[float, DVS] = {}
        self._blocks, self._light = BlockBootstrap(light.shape), light
        self._wanted = real.sum(axis=(1, 2))
        self._real, self._real_light = self._sums(real)
        self._counts: dict[float, np.ndarray] = {}
        self._apart: dict[float, np.ndarray] = {}

    def _sums(self, counts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the numbers of events [2, samples], and the mean log brightness at those of free thresholds."""
        sums = np.stack([self._blocks.sums(some) for some in counts])
        light = sum(self._blocks.sums(some * self._light) for some in counts[self.free])
        return sums, np.asarray(light / np.maximum(sums[self.free].sum(axis=0), 1))

    def add(self, dark: float) -> None:
        """Match the thresholds at a value of `dark`, starting from those of the nearest `dark` tried before."""
        if dark in self.tried:
            return
        near = min(self.tried, key=lambda other: abs(math.log(dark / other)), default=None)
        start = replace(self.trial, dark=dark)
        if near is not None:
            known, scale = self.tried[near], (MIDDLE + near) / (MIDDLE + dark)
            off, on = (min(max(value * scale, LEAST), MOST) for value in (known.off, known.on))
            start = replace(start, off=off if self.free[0] else start.off, on=on if self.free[1] else start.on)
        self.tried[dark], events = match_thresholds(start, self.frames, self._wanted, self.free)
        self._counts[dark], light = self._sums(count_images(events))
        self._apart[dark] = light - self._real_light

    def places(self) -> np.ndarray:
        """Return the logarithm of the best `dark` of each bootstrap sample, limited to the range of values tried."""
        darks = sorted(self.tried)
        # brightness rises with `dark`, apart from rounding
        apart = np.maximum.accumulate([self._apart[dark] for dark in darks])
        above = (apart >= 0).argmax(axis=0)
        right = np.where(apart[-1] < 0, len(darks) - 1, above).clip(1)
        low, high = (np.take_along_axis(apart, index[None], 0)[0] for index in (right - 1, right))
        share = np.divide(-low, high - low, out=np.zeros(low.size), where=high > low).clip(0, 1)
        logs = np.log(darks)
        return np.asarray(logs[right - 1] + share * (logs[right] - logs[right - 1]))

    def beyond(self) -> float | None:
        """Return the next value of `dark` to try, outside the range of those tried.

        None if this range contains the confidence interval of `dark`, or if a limit is reached.
        """
        least, most = min(self.tried), max(self.tried)
        low, high = interval(self.places())
        if high >= math.log(most) and most < BRIGHTEST:
            return min(2 * most, BRIGHTEST)
        if low <= math.log(least) and least > DARKEST:
            return max(least / 2, DARKEST)
        return None

    def intervals(self, dark: float) -> dict[str, tuple[float, float]]:
        """Return the confidence intervals of `dark`, whose estimate is the argument, and of the free thresholds."""
        darks, places = sorted(self.tried), self.places()
        low, high = np.exp(interval(places)).tolist()
        found = {"dark": (min(low, dark), max(high, dark))}
        chosen = self.tried[dark]
        for n, name in enumerate(NAMES):
            if not self.free[n]:
                continue
            value = getattr(chosen, name)
            higher = replace(chosen, **{name: value * math.exp(STEP)}).emulate(self.frames)
            change = math.log((polarity_counts(higher)[n] + 1) / (self._counts[dark][n, 0] + 1))
            # counts fall as thresholds rise; the limit keeps intervals finite where they hardly do
            slope = min(change / STEP, -0.1)
            matched = [
                math.log(getattr(self.tried[one], name))
                + np.log((np.maximum(self._real[n], 0) + 1) / (self._counts[one][n] + 1)) / slope
                for one in darks
            ]
            samples = _interpolated(places, np.log(darks), np.stack(matched))
            found[name] = interval(value * np.exp(samples - samples[0]))
        return found


def _interpolated(places: np.ndarray, known: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Interpolate each column of `values` [known, samples] linearly at its entry of `places`; return [samples]."""
    right = np.searchsorted(known, places).clip(1, known.size - 1)
    share = (places - known[right - 1]) / (known[right] - known[right - 1])
    columns = np.arange(places.size)
    return np.asarray(values[right - 1, columns] * (1 - share) + values[right, columns] * share)


def fit_thresholds(
    start: DVS, given: DVS, frames: list[VideoFrame], real: Events, needed: np.ndarray, unidentified: dict[str, str]
) -> DVS:
    """Return the settings with thresholds that result in the numbers of events in `real`.

    A threshold that can't be identified is copied from `given`, and the reason is added to `unidentified`. Then the
    search for the other threshold is repeated. If neither can be identified, `given` is returned, and `dark` counts as
    unidentified, too.

    Args:
        start: Settings to begin with.
        given: Settings with the thresholds to use if they can't be identified.
        frames: Frames of the scene.
        real: Events of the sensor.
        needed: [2], the numbers of OFF and ON events of `real` that leak and noise don't explain. A threshold with
            fewer than `FEWEST` events can't be identified.
        unidentified: Reasons by setting; new ones are added.
    """
    for name, moved in zip(NAMES, needed, strict=True):
        if name not in unidentified and moved < FEWEST:
            unidentified[name] = f"{max(moved, 0):.0f} events of this polarity, at least {FEWEST} are needed"
    wanted = polarity_counts(real)
    while free := [name for name in NAMES if name not in unidentified]:
        start = replace(start, **{name: getattr(given, name) for name in NAMES if name not in free})
        start, found = match_thresholds(start, frames, wanted, np.array([name in free for name in NAMES]))
        counts = polarity_counts(found)
        apart = {name: abs(math.log((counts[n] + 1) / (wanted[n] + 1))) for n, name in enumerate(NAMES) if name in free}
        # one at a time, because a threshold that can't be found affects the search for the other
        name = max(apart, key=lambda one: apart[one])
        if apart[name] <= FAR:
            return start
        n, value = NAMES.index(name), getattr(start, name)
        unidentified[name] = (
            f"no threshold from {LEAST} to {MOST} results in {wanted[n]} events; {value:.3g} results in {counts[n]}"
        )
    unidentified["dark"] = "neither threshold is known"
    return given


def check_counts(found: Events, real: Events, unidentified: dict[str, str], still: bool) -> None:
    """Compare the result's numbers of events with the sensor's, and add a mismatch to `unidentified`.

    Args:
        found: Events of the result.
        real: Events of the sensor.
        unidentified: Reasons by setting; new ones are added.
        still: True if light is constant.

    Raises:
        ValueError: The numbers differ, neither threshold could be estimated, and something moves.
    """
    ours, theirs = polarity_counts(found), polarity_counts(real)
    # the second term is four standard deviations of Poisson counts
    apart = np.abs(ours - theirs) > FAR * theirs + 4 * np.sqrt(ours + theirs)
    if apart.any() and not still and {*NAMES} <= unidentified.keys():
        why = "; ".join(f"{name}: {unidentified[name]}" for name in NAMES)
        given = f"with those of `base`, {ours.sum()} events are emulated, but the sensor has {theirs.sum()}"
        way = "record motion, or pass noise=True and delay=0 to estimate leak and noise of a still scene"
        raise ValueError(f"these frames and events determine neither threshold ({why}); {given}; {way}")
    hint = ", because these frames are noisy: emulate their mean" if still else ""
    for n in np.flatnonzero(apart):
        reason = f"{ours[n]} events are emulated, but the sensor has {theirs[n]}{hint}"
        unidentified[NAMES[n]] = "; ".join(filter(None, (unidentified.get(NAMES[n]), reason)))


class _Bracket:
    """Interval in which a threshold is searched: at the lower end events are too many, at the upper end too few.

    All values are logarithms: of thresholds, and of the numbers of events divided by those wanted. Without this
    interval, steps would overshoot: if few events are left, their number falls ten times as fast as the threshold
    rises.
    """

    def __init__(self) -> None:
        self.low, self.more = math.log(LEAST), math.nan
        self.high, self.fewer = math.log(MOST), math.nan

    def next(self, value: float, apart: float) -> float:
        """Return the threshold to try after `value`, which resulted in exp(`apart`) times the events wanted."""
        if apart == 0:
            return value
        if apart > 0:
            self.low, self.more = value, apart
        else:
            self.high, self.fewer = value, apart
        if self.high - self.low < NARROW:
            # the solution has moved, because the other polarity's threshold has changed
            self.low, self.high = max(value - WIDE, math.log(LEAST)), min(value + WIDE, math.log(MOST))
            self.more = self.fewer = math.nan
        if math.isnan(self.more + self.fewer):
            # counts fall about as fast as thresholds rise, or faster
            return min(max(value + 0.6 * apart, self.low), self.high)
        share = self.more / (self.more - self.fewer)
        return self.low + (self.high - self.low) * min(max(share, 0.1), 0.9)
