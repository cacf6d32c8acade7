"""Images of what pixels last saw: latest times, and sums that leak. IndexError for events outside of them."""

from __future__ import annotations

import numpy as np

from nvsdata.kernels import _native


def counts_and_times(
    t: np.ndarray, x: np.ndarray, y: np.ndarray, p: np.ndarray, start: int, duration: int, out: np.ndarray
) -> None:
    """Add events to `out` float32 [4, H, W]: numbers of ON and OFF events, and their latest times.

    Times from `start` are fractions of `duration`. O(N).
    """
    _native.counts_and_times(t, x, y, p, start, duration, out)


def leak_into(
    t: np.ndarray, x: np.ndarray, y: np.ndarray, increment: float, leak: float, value: np.ndarray, since: np.ndarray
) -> None:
    """Add `increment` to `value` for each event; values fall by `leak` per µs, not below 0. O(N).

    `value` float64 and `since` int64, both [H, W], are the state: values, and when they were so.
    """
    _native.leak_into(t, x, y, increment, leak, value, since)


def remember(t: np.ndarray, x: np.ndarray, y: np.ndarray, p: np.ndarray, times: np.ndarray, counts: np.ndarray) -> None:
    """Put times into the rings `times` int64 [2, k, H, W], counted by `counts` int64 [2, H, W], ON first. O(N)."""
    _native.remember(t, x, y, p, times, counts)


def logarithms(age: np.ndarray, known: np.ndarray, least: float, most: float) -> np.ndarray:
    """Return `logarithms_of_ages` for ages int64 [N]: float32 [N], as of age `most` where they aren't `known`. O(N)."""
    out = np.empty(age.size, np.float32)
    _native.logarithms(age, known, least, most, out)
    return out


def logarithms_of_ages(
    t: np.ndarray,
    x: np.ndarray,
    y: np.ndarray,
    p: np.ndarray,
    end: int,
    least: float,
    most: float,
    have: np.ndarray,
    out: np.ndarray,
) -> None:
    """Put log(age + 1), from `least` up to `most`, minus `least`, of pixels' latest events into `out` [2, k, H, W].

    Ages are those at `end`, ON and the latest event come first. `out` is float32, `have` int32 [2, H, W] is scratch, 0.
    O(N).
    """
    _native.logarithms_of_ages(t, x, y, p, end, least, most, have, out)


def queue_bins(
    t: np.ndarray,
    x: np.ndarray,
    y: np.ndarray,
    p: np.ndarray,
    origin: int,
    duration: int,
    bins: np.ndarray,
    within: np.ndarray,
    used: np.ndarray,
) -> None:
    """Add times to queues of the latest bins of `duration` from `origin` on that have events, OFF first. O(N).

    `bins` int64 [2, H, W, K], and `within` float64 [2, H, W, K, 2], the sum of times from a bin's beginning and their
    number, are rings, in which `used` int64 [2, H, W] slots were ever begun.
    """
    _native.queue_bins(t, x, y, p, origin, duration, bins, within, used)


def ages_of_bins(
    since: int, duration: int, bins: np.ndarray, within: np.ndarray, used: np.ndarray, out: np.ndarray
) -> None:
    """Put 1 - log(1 + age) / 8.7, not below 0, of what `queue_bins` kept into `out`, the latest last.

    `out` is float32 [K, 2, H, W]. Ages are those `since` µs after the origin, in bins. O(pixels + kept bins).
    """
    _native.ages_of_bins(since, duration, bins, within, used, out)


def latest_ticks(
    t: np.ndarray,
    x: np.ndarray,
    y: np.ndarray,
    p: np.ndarray,
    start: int,
    tick: int,
    now: int,
    decay: float,
    out: np.ndarray,
) -> None:
    """Put what is left of each pixel's latest event, as of 1, 2, ... ticks ago, into `out` [K, 2, H, W]. O(N K).

    float32: 1 in the tick of the event, and less by 1 / `decay` with each tick, not below 0. ON comes first.
    """
    _native.latest_ticks(t, x, y, p, start, tick, now, decay, out)
