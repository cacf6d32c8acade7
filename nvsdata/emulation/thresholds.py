"""Thresholds that give as many events as a real sensor did."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from nvsdata.data.events import Events
from nvsdata.emulation.dvs import DVS
from nvsdata.video.frames import Frame

LEAST, MOST = 0.01, 3.0  # thresholds
CLOSE, FAR = 0.003, 0.05  # differences of logarithms of event counts: found, not found
ROUNDS = 25
NARROW, WIDE = 1e-4, 0.1  # logarithms between which there is no threshold left to try, and what is added then
FEWEST = 100  # events of a polarity from which its threshold can be told
NAMES = ("off", "on")


def counts_of(events: Events) -> np.ndarray:
    """Numbers of OFF and of ON events."""
    return np.bincount(events.p, minlength=2)[:2]


def matched(trial: DVS, frames: list[Frame], wanted: np.ndarray, free: np.ndarray) -> DVS:
    """The settings with thresholds that give `wanted` OFF and ON events, up to a difference of logarithms, `CLOSE`.

    Only thresholds that are `free` change. The nearest of those that were tried, if none do.
    """
    brackets = _Bracket(), _Bracket()
    value = [math.log(trial.off), math.log(trial.on)]
    best, nearest = trial, math.inf
    wanted = np.maximum(wanted, 1)
    for _ in range(ROUNDS):
        off, on = map(math.exp, value)
        trial = replace(trial, off=off if free[0] else trial.off, on=on if free[1] else trial.on)
        apart = np.where(free, np.log((counts_of(trial.emulate(frames)) + 1) / (wanted + 1)), 0)
        if np.abs(apart).max() < nearest:
            best, nearest = trial, float(np.abs(apart).max())
        before, value = value, [b.next(*at) for b, *at in zip(brackets, value, apart.tolist(), strict=True)]
        if nearest < CLOSE or value == before:
            break
    return best


def settled(
    start: DVS, given: DVS, frames: list[Frame], real: Events, needed: np.ndarray, untold: dict[str, str]
) -> DVS:
    """The settings with thresholds that give the numbers of events in `real`; notes why a threshold is `untold`.

    An untold threshold is that of `given`, and the other one is looked for with it. `needed` are the events of each
    polarity that leak and noise don't explain.
    """
    for name, moved in zip(NAMES, needed, strict=True):
        if moved < FEWEST:
            untold[name] = f"{max(moved, 0):.0f} events of this polarity, at least {FEWEST} are needed"
    wanted = counts_of(real)
    while free := [name for name in NAMES if name not in untold]:
        start = replace(start, **{name: getattr(given, name) for name in NAMES if name not in free})
        start = matched(start, frames, wanted, np.array([name in free for name in NAMES]))
        counts = counts_of(start.emulate(frames))
        apart = {name: abs(math.log((counts[n] + 1) / (wanted[n] + 1))) for n, name in enumerate(NAMES) if name in free}
        # one at a time, because one that can't be found keeps the other from its best
        name = max(apart, key=lambda one: apart[one])
        if apart[name] <= FAR:
            return start
        n, value = NAMES.index(name), getattr(start, name)
        untold[name] = f"no threshold from {LEAST} to {MOST} gives {wanted[n]} events; {value:.3g} gives {counts[n]}"
    untold["dark"] = "neither threshold is known"
    return given


def check_noise(found: Events, real: Events, untold: dict[str, str]) -> None:
    """ValueError unless settings without any threshold from the pair give as many events as the sensor did."""
    ours, theirs = counts_of(found), counts_of(real)
    # and what chance makes of them
    if (np.abs(ours - theirs) > FAR * theirs + 4 * np.sqrt(ours + theirs)).any():
        why = "; ".join(f"{name}: {untold[name]}" for name in NAMES)
        given = f"with those of `base` {ours.sum()} events are emulated for {theirs.sum()}"
        raise ValueError(f"these frames and events determine neither threshold ({why}), and {given}")


class _Bracket:
    """Between which thresholds one is looked for: one that gives too many events, and one that gives too few.

    In logarithms, of thresholds and of the numbers of events over those wanted. Without it, steps overshoot: events
    become fewer ten times as fast as thresholds rise where few are left.
    """

    def __init__(self) -> None:
        self.low, self.more = math.log(LEAST), math.nan
        self.high, self.fewer = math.log(MOST), math.nan

    def next(self, value: float, apart: float) -> float:
        """The threshold to try after `value`, which gave exp(`apart`) times the events wanted."""
        if apart == 0:
            return value
        if apart > 0:
            self.low, self.more = value, apart
        else:
            self.high, self.fewer = value, apart
        if self.high - self.low < NARROW:
            # it has moved, because the other polarity's threshold has
            self.low, self.high = max(value - WIDE, math.log(LEAST)), min(value + WIDE, math.log(MOST))
            self.more = self.fewer = math.nan
        if math.isnan(self.more + self.fewer):
            # counts fall about as thresholds rise, or faster
            return min(max(value + 0.6 * apart, self.low), self.high)
        share = self.more / (self.more - self.fewer)
        return self.low + (self.high - self.low) * min(max(share, 0.1), 0.9)
