"""Estimates of leak, noise and the refractory period from events that a real sensor recorded."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from nvsdata.data.events import Events
from nvsdata.emulation.correlation import correlation, pixel_index
from nvsdata.emulation.dvs import DVS
from nvsdata.emulation.imperfections import AT_WHITE
from nvsdata.emulation.thresholds import match_thresholds, polarity_counts
from nvsdata.video.frames import VideoFrame

CALM = 0.05  # change of ln(q + 3) up to which light counts as constant
QUIET = 100.0  # pixels times seconds of constant light that an estimate of noise needs
RAREST = 0.001  # fraction of the intervals between events of a pixel that may be shorter than the refractory period
SOONER = 2  # factor by which the shortest emulated intervals must be shorter than the sensor's
SHARP = 1.25  # largest ratio of the 1% to the 0.1% quantile of intervals at a refractory period, which is a sharp limit
REPEATED = 1_000  # intervals between events of a pixel that an estimate of the refractory period needs
WORSE = 0.02  # fall of the correlation from which an estimated leak isn't used
NO_EVENTS = np.zeros((2, 1, 1))  # OFF and ON events of leak and noise per pixel, if these aren't estimated


def fit_noise(
    settings: DVS, light: np.ndarray, real: Events, still: bool, unidentified: dict[str, str]
) -> tuple[DVS, np.ndarray]:
    """Estimate leak and noise from the events at pixels under constant light.

    Args:
        settings: Settings to change.
        light: ln(q + 3) of the frames, [T, H, W].
        real: Events of the sensor during the frames.
        still: Count light as constant at all pixels.
        unidentified: Reasons by setting; new ones are added.

    Returns:
        The settings, and the numbers of OFF and ON events that leak and noise explain at each pixel, float64 [2, H, W].
    """
    calm = (np.ptp(light, axis=0) < CALM) | still
    # the neighborhood of a moving edge isn't calm, either
    for axis in (0, 1):
        calm = calm & np.roll(calm, 1, axis) & np.roll(calm, -1, axis)
    seconds = (real.end - real.start) / 1e6
    if calm.sum() * seconds < QUIET:
        reason = f"only {calm.sum() * seconds:.0f} pixel-seconds of constant light, {QUIET:.0f} are needed"
        unidentified |= {"leak": reason, "noise_rate": reason}
        return settings, NO_EVENTS
    inside = calm.ravel()[pixel_index(real)]
    off, on = np.bincount(real.p[inside], minlength=2)[:2].tolist()
    # a significant excess of ON events over OFF events is leak
    more = on - off if on - off > 3 * math.sqrt(on + off) else 0
    leak, common = more / (calm.sum() * seconds), (on + off - more) / (calm.sum() * seconds)
    gray = np.exp(light.mean(axis=0)) - 3
    share = 1 - (1 - AT_WHITE) * gray / 255
    rate = common / float(share[calm].mean())
    expected = np.stack((rate * share / 2, rate * share / 2 + leak)) * seconds
    return replace(settings, leak=round(float(leak), 4), noise_rate=round(float(rate), 4)), expected


def without_harmful_leak(
    settings: DVS,
    base: DVS,
    best: DVS,
    frames: list[VideoFrame],
    real: Events,
    free: np.ndarray,
    unidentified: dict[str, str],
) -> DVS:
    """Return the settings without the estimated leak if it lowers the correlation with the sensor's events.

    With a leak, pixels start at random distances from their thresholds. Therefore many of them fire at changes far
    below a threshold. In noisy frames, such events occur at all pixels.

    Args:
        settings: Settings with the leak.
        base: Settings with the leak to return to.
        best: Settings with thresholds to begin with.
        frames: Frames of the scene.
        real: Events of the sensor.
        free: Mask of the thresholds that may change, OFF and ON.
        unidentified: Reasons by setting; new ones are added.
    """
    if settings.leak == base.leak:
        return settings
    trials = [replace(best, leak=leak) for leak in (settings.leak, base.leak)]
    found = [match_thresholds(trial, frames, polarity_counts(real), free)[1] for trial in trials]
    leaky, other = (correlation(events, real) for events in found)
    if leaky > other - WORSE:
        return settings
    unidentified["leak"] = (
        f"a leak of {settings.leak:g} Hz lowers the correlation from {other:.2f} to {leaky:.2f}: the frames are noisy"
    )
    return replace(settings, leak=base.leak)


def fit_refractory(settings: DVS, found: Events, real: Events, unidentified: dict[str, str]) -> DVS:
    """Return the settings with the refractory period, if it can be estimated.

    Real pixels hardly ever fire again within this period, though emulated ones do.

    Args:
        settings: Settings to change.
        found: Events that are emulated without a refractory period.
        real: Events of the sensor.
        unidentified: Reasons by setting; new ones are added.
    """
    gaps, ours = event_intervals(real), event_intervals(found)
    if min(gaps.size, ours.size) < REPEATED:
        unidentified["refractory"] = (
            f"only {min(gaps.size, ours.size)} intervals between events of a pixel, {REPEATED} are needed"
        )
        return settings
    least, few = np.quantile(gaps, (RAREST, 10 * RAREST)).tolist()
    # at a refractory period, intervals end sharply; without one, short intervals get rarer gradually, or there are none
    if few > SHARP * least or np.quantile(ours, RAREST) > least / SOONER:
        unidentified["refractory"] = "pixels don't fire again soon enough to reach this period"
        return settings
    return replace(settings, refractory=int(least))


def event_intervals(events: Events) -> np.ndarray:
    """Return the intervals (µs) between successive events of each pixel."""
    order = np.lexsort((events.t, pixel_index(events)))
    return np.asarray(np.diff(events.t[order])[np.diff(pixel_index(events)[order]) == 0])
