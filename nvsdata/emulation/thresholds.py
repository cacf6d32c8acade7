"""Search for thresholds that give as many events as a real sensor."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from nvsdata.data.events import Events
from nvsdata.emulation.dvs import DVS
from nvsdata.video.frames import VideoFrame

LEAST, MOST = 0.01, 3.0  # thresholds
CLOSE, FAR = 0.003, 0.05  # differences of logarithms of event counts: up to CLOSE found, beyond FAR not found
ROUNDS = 25
NARROW, WIDE = 1e-4, 0.1  # logarithms: width below which a bracket is exhausted, and width to which it is opened again
FEWEST = 100  # events of a polarity that its threshold needs
NAMES = ("off", "on")


def polarity_counts(events: Events) -> np.ndarray:
    """Return the numbers of OFF and of ON events."""
    return np.bincount(events.p, minlength=2)[:2]


def match_thresholds(trial: DVS, frames: list[VideoFrame], wanted: np.ndarray, free: np.ndarray) -> DVS:
    """Return the settings with thresholds that give `wanted` events, or else the nearest that were tried.

    Args:
        trial: Settings to begin with.
        frames: Frames of the scene.
        wanted: Numbers of OFF and of ON events; found if logarithms differ by less than `CLOSE`.
        free: Whether the thresholds OFF and ON may change.
    """
    brackets = _Bracket(), _Bracket()
    value = [math.log(trial.off), math.log(trial.on)]
    best, nearest = trial, math.inf
    wanted = np.maximum(wanted, 1)
    for _ in range(ROUNDS):
        off, on = map(math.exp, value)
        trial = replace(trial, off=off if free[0] else trial.off, on=on if free[1] else trial.on)
        apart = np.where(free, np.log((polarity_counts(trial.emulate(frames)) + 1) / (wanted + 1)), 0)
        if np.abs(apart).max() < nearest:
            best, nearest = trial, float(np.abs(apart).max())
        before, value = value, [b.next(*at) for b, *at in zip(brackets, value, apart.tolist(), strict=True)]
        if nearest < CLOSE or value == before:
            break
    return best


def fit_thresholds(
    start: DVS, given: DVS, frames: list[VideoFrame], real: Events, needed: np.ndarray, unidentified: dict[str, str]
) -> DVS:
    """Return the settings with thresholds that give the numbers of events in `real`.

    A threshold that can't be identified is that of `given`, and `unidentified` gets the reason. The other threshold is
    searched with it.

    Args:
        start: Settings to begin with.
        given: Settings of thresholds that can't be identified.
        frames: Frames of the scene.
        real: Events of the sensor.
        needed: Numbers of OFF and of ON events that leak and noise don't explain.
        unidentified: Reasons by setting; gets new ones.
    """
    for name, moved in zip(NAMES, needed, strict=True):
        if moved < FEWEST:
            unidentified[name] = f"{max(moved, 0):.0f} events of this polarity, at least {FEWEST} are needed"
    wanted = polarity_counts(real)
    while free := [name for name in NAMES if name not in unidentified]:
        start = replace(start, **{name: getattr(given, name) for name in NAMES if name not in free})
        start = match_thresholds(start, frames, wanted, np.array([name in free for name in NAMES]))
        counts = polarity_counts(start.emulate(frames))
        apart = {name: abs(math.log((counts[n] + 1) / (wanted[n] + 1))) for n, name in enumerate(NAMES) if name in free}
        # one at a time, because a threshold that can't be found spoils the other
        name = max(apart, key=lambda one: apart[one])
        if apart[name] <= FAR:
            return start
        n, value = NAMES.index(name), getattr(start, name)
        unidentified[name] = (
            f"no threshold from {LEAST} to {MOST} gives {wanted[n]} events; {value:.3g} gives {counts[n]}"
        )
    unidentified["dark"] = "neither threshold is known"
    return given


def check_noise(found: Events, real: Events, unidentified: dict[str, str]) -> None:
    """Raise ValueError unless settings without a threshold from the pair give as many events as the sensor."""
    ours, theirs = polarity_counts(found), polarity_counts(real)
    # and the spread of Poisson counts
    if (np.abs(ours - theirs) > FAR * theirs + 4 * np.sqrt(ours + theirs)).any():
        why = "; ".join(f"{name}: {unidentified[name]}" for name in NAMES)
        given = f"with those of `base` {ours.sum()} events are emulated for {theirs.sum()}"
        raise ValueError(f"these frames and events determine neither threshold ({why}), and {given}")


class _Bracket:
    """Bracket of a threshold: a lower one gives too many events, a higher one too few.

    All values are logarithms, of thresholds and of the numbers of events divided by those wanted. Without a bracket,
    steps overshoot: where few events are left, their number falls ten times as fast as the threshold rises.
    """

    def __init__(self) -> None:
        self.low, self.more = math.log(LEAST), math.nan
        self.high, self.fewer = math.log(MOST), math.nan

    def next(self, value: float, apart: float) -> float:
        """Return the threshold to try after `value`, which gave exp(`apart`) times the events wanted."""
        if apart == 0:
            return value
        if apart > 0:
            self.low, self.more = value, apart
        else:
            self.high, self.fewer = value, apart
        if self.high - self.low < NARROW:
            # the right value moved, because the other polarity's threshold did
            self.low, self.high = max(value - WIDE, math.log(LEAST)), min(value + WIDE, math.log(MOST))
            self.more = self.fewer = math.nan
        if math.isnan(self.more + self.fewer):
            # counts fall about as fast as thresholds rise, or faster
            return min(max(value + 0.6 * apart, self.low), self.high)
        share = self.more / (self.more - self.fewer)
        return self.low + (self.high - self.low) * min(max(share, 0.1), 0.9)
