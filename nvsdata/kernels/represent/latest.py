"""Images of the times of each pixel's latest events, and of leaky sums.

Events outside the image raise an IndexError.
"""

from __future__ import annotations

import numpy as np

from nvsdata.kernels import _native


def counts_and_times(
    t: np.ndarray, x: np.ndarray, y: np.ndarray, p: np.ndarray, start: int, duration: int, out: np.ndarray
) -> None:
    """Add events to `out` float32 [4, H, W]: numbers of ON and OFF events, and their latest times.

    Times are measured from `start`, as fractions of `duration`. O(N).
    """
    _native.counts_and_times(t, x, y, p, start, duration, out)


def leak_into(
    t: np.ndarray, x: np.ndarray, y: np.ndarray, increment: float, leak: float, value: np.ndarray, since: np.ndarray
) -> None:
    """Add `increment` to `value` for each event; values decrease by `leak` per µs, but not below 0. O(N).

    The state is `value` float64 [H, W], and `since` int64 [H, W] with the times in µs to which the values apply.
    """
    _native.leak_into(t, x, y, increment, leak, value, since)


def push_times(
    t: np.ndarray, x: np.ndarray, y: np.ndarray, p: np.ndarray, times: np.ndarray, counts: np.ndarray
) -> None:
    """Store the times of events in ring buffers `times` int64 [2, k, H, W], ON first. O(N).

    `counts` int64 [2, H, W] has the numbers of events so far, and is updated.
    """
    _native.push_times(t, x, y, p, times, counts)


def logarithms(age: np.ndarray, known: np.ndarray, least: float, most: float) -> np.ndarray:
    """Return log(age + 1), clipped to `least` to `most`, minus `least`: float32 [N]. O(N).

    Ages (µs) that aren't `known` give `most` - `least`.
    """
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
    """Write log(age + 1) of each pixel's latest events to `out` float32 [2, k, H, W], clipped to `least` .. `most`.

    `least` is subtracted afterwards. Ages are measured at the time `end`. ON comes first, and the latest event comes
    first. `have` int32 [2, H, W] is scratch memory and must be 0. O(N).
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
    """Add times to queues of bins of `duration` µs: each pixel has a queue of its latest bins with events. O(N).

    Bins are numbered from the time `origin`; OFF comes first. The ring buffers are `bins` int64 [2, H, W, K] with the
    numbers of the bins, and `within` float64 [2, H, W, K, 2] with the sum of the times since the beginning of the bin,
    and the number of its events. `used` int64 [2, H, W] has the numbers of slots used so far.
    """
    _native.queue_bins(t, x, y, p, origin, duration, bins, within, used)


def ages_of_bins(
    since: int, duration: int, bins: np.ndarray, within: np.ndarray, used: np.ndarray, out: np.ndarray
) -> None:
    """Write max(1 - log(1 + age) / 8.7, 0) of the bins in the queues to `out`, with the latest bin last.

    `out` is float32 [K, 2, H, W]. Ages are in bins, at `since` µs after the origin. O(pixels + kept bins).
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
    """Write the decayed value of the latest event of each pixel, 1, 2, ... ticks ago, to `out` [K, 2, H, W]. O(N K).

    The value (float32) is 1 in the tick of the event and decreases by 1 / `decay` per tick, but not below 0. ON comes
    first.
    """
    _native.latest_ticks(t, x, y, p, start, tick, now, decay, out)
