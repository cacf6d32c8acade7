"""Fit of camera time to host time, by flashes of a screen in front of the camera."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from nvsdata.data.events import Events

BIN = 1_000  # µs of the coarse search
PLACES = 4  # candidates for the position of the pattern that are examined
SMEAR = 5  # bins over which the events of a flash spread
LONGEST = 25_000  # µs that the events of a flash last: a screen changes line by line, and the readout is limited
ONSET = 0.05  # fraction of the events of a flash after which the flash counts as begun
NEAR = 12_000  # µs by which a flash may differ from its expected time: less than a frame at 60 Hz
GROUP = 3e6  # µs; longest duration of a group of flashes
MOST_DRIFT = 500e-6  # largest drift of the camera's clock relative to the host's
A_REFRESH = 34_000  # µs by which the slowest screens may show a frame late
LEAST = 0.6  # fraction of the flashes that must be found
LOOSE = 400.0  # µs; a flash this close to the fit always agrees with it


class NoSync(ValueError):
    """The flashes can't be matched with the events; the message has the reason."""


@dataclass(frozen=True)
class ClockFit:
    """Linear fit of camera time to host time: camera time = offset + (1 + drift) x host time.

    Args:
        offset: Camera time at host time 0, in µs.
        drift: Relative difference of the clocks' speeds.
        residual: Median distance of the flashes from this line, in µs.
        used: Number of flashes that agree with the line.
        flashes: Number of all flashes.
    """

    offset: float
    drift: float
    residual: float
    used: int
    flashes: int

    def camera(self, host: float) -> float:
        """Return the camera time (µs) of a host time (µs)."""
        return self.offset + (1 + self.drift) * host

    def host(self, camera: float) -> float:
        """Return the host time (µs) of a camera time (µs)."""
        return (camera - self.offset) / (1 + self.drift)


def flashes(length: int = 31) -> np.ndarray:
    """Return the brightness, 0 or 1, of each step of the flash pattern.

    The pattern is a maximum length sequence, which hardly correlates with its shifts.
    """
    # the sequence begins with a single flash; scipy.signal has such sequences, but importing it takes a second
    bits = [1, 0, 0, 0, 0]
    while len(bits) < 31:
        bits.append(bits[-5] ^ bits[-3])
    return np.resize(np.array(bits, np.uint8), length)


def fit_clock(seen: Events | Sequence[int], shown: np.ndarray, bright: np.ndarray) -> ClockFit:
    """Match the flashes of a screen with the events or triggers that they caused, and fit camera time to host time.

    The flashes may be several groups, such as before and after a video; events between groups may be missing. A flash
    that was shown late, or not at all, is an outlier and left out.

    First, the pattern of a group of flashes is found by correlation, with a resolution of 1 ms. Then each flash is
    located by the time at which its events begin, and a line is fitted to the flashes that agree. ON and OFF events may
    have different delays; the mean of both is taken as the delay of the camera.

    Args:
        seen: The camera's events, or the times (µs, rising) of triggers from a photodiode in front of the screen. There
            is a trigger at each change to bright, and there may be others.
        shown: Host times (µs, rising) at which the entire screen changed, [n].
        bright: True for changes to bright (ON events), False for changes to dark (OFF events), [n].

    Raises:
        NoSync: Too few flashes agree.
    """
    host, rising = np.asarray(shown, np.float64), np.asarray(bright, bool)
    sight: _Rates | _Triggers
    if isinstance(seen, Events):
        sight = _Rates(seen)
    else:
        sight = _Triggers(np.asarray(seen, np.float64))
        host, rising = host[rising], rising[rising]
    if host.size < 6 or sight.count == 0:
        raise NoSync(f"{host.size} flashes and {sight.count} {sight.what} can't be matched")
    group = host - host[0] < GROUP
    # the pattern repeats after the video, or the video may resemble it: the position with most matches is taken
    tried = [_matched(sight, host, rising, group, offset) for offset in sight.coarse(host[group], rising[group])]
    camera = max(tried, key=lambda times: int(np.isfinite(times).sum()))
    found = np.isfinite(camera)
    if found.sum() < max(6, LEAST * host.size):
        raise NoSync(f"the camera saw only {int(found.sum())} of {host.size} flashes: point it at the entire screen")
    offset, slope, residual, used = _line(host[found], camera[found], rising[found])
    if used < LEAST * host.size:
        raise NoSync(f"only {used} of {host.size} flashes agree in time")
    if abs(slope - 1) > MOST_DRIFT:
        off, late = f"the camera's clock is {abs(slope - 1) * 1e6:.0f} ppm off", (slope - 1) * np.ptp(host)
        if abs(late) <= A_REFRESH:
            raise NoSync(
                f"{off}, or flashes were shown up to {abs(late) / 1e3:.0f} ms late: check the screen's refresh rate"
            )
        raise NoSync(f"{off}, which is implausible: the flashes may be matched wrongly")
    return ClockFit(offset, slope - 1, residual, used, host.size)


def _matched(
    sight: _Rates | _Triggers, host: np.ndarray, rising: np.ndarray, group: np.ndarray, offset: float
) -> np.ndarray:
    """Return the camera times of the flashes, NaN for those not found.

    For the first `group`, camera time minus host time is `offset` (µs).
    """
    camera = np.full(host.size, np.nan)
    for n in range(host.size):
        # after the first group, the last flashes predict the next one, less accurately after a longer time
        last = np.flatnonzero(np.isfinite(camera))[-8:]
        ahead = offset if group[n] or not last.size else float(np.median(camera[last] - host[last]))
        gap = host[n] - (host[last[-1]] if last.size else host[0])
        if MOST_DRIFT * gap > NEAR:
            # the entire pattern is searched again, because several single flashes may be equally near
            group = (host >= host[n]) & (host - host[n] < GROUP)
            places = [*sight.coarse(host[group], rising[group]), ahead]
            offset = ahead = next(place for place in places if abs(place - ahead) <= NEAR + MOST_DRIFT * gap)
        camera[n] = sight.near(host[n] + ahead, bool(rising[n]), NEAR + min(MOST_DRIFT * gap, NEAR))
    return camera


class _Rates:
    """Flashes in the rate of events."""

    what = "events"

    def __init__(self, events: Events) -> None:
        self.events, self.count = events, len(events)

    def coarse(self, host: np.ndarray, rising: np.ndarray) -> list[float]:
        """Return likely values of camera time minus host time (µs), where flashes correlate with ON - OFF events."""
        events = self.events
        first = int(events.t[0])
        bins = (events.t - first) // BIN
        rate = np.bincount(bins, np.where(events.p, 1.0, -1.0))
        # a burst counts by the square root of its size, so that one bright object doesn't outweigh the pattern
        rate = np.sign(rate) * np.sqrt(np.abs(rate))
        places = _pattern(np.convolve(rate, np.ones(SMEAR), "full")[SMEAR - 1 :], host, rising)
        return [first + place for place in places]

    def near(self, expected: float, rising: bool, near: float) -> float:
        """Return the time at which a flash's events begin, within `near` µs of `expected`; NaN if there is no flash."""
        events = self.events
        lo, hi = np.searchsorted(events.t, (expected - near, expected + near + LONGEST))
        t = events.t[lo:hi][events.p[lo:hi] == rising]
        if t.size < 20:
            return float("nan")
        # a flash takes less than half of the bins, so their median is the noise
        bins = (t - int(expected - near)) // BIN
        counts = np.bincount(bins, minlength=int((2 * near + LONGEST) // BIN))
        noise = float(np.median(counts))
        peak = int(counts.argmax())
        level = noise + max(4 * noise**0.5, 0.02 * counts[peak], 1)
        if counts[peak] <= level:
            return float("nan")
        first, last = _above(counts, peak, level)
        inside = t[(bins >= first) & (bins <= last)]
        surplus = np.arange(1, inside.size + 1) - noise / BIN * (inside - inside[0])
        if surplus[-1] < max(6 * (noise * (last - first + 1)) ** 0.5, 10):
            return float("nan")
        return float(inside[np.argmax(surplus >= ONSET * surplus[-1])])


def _above(counts: np.ndarray, peak: int, level: float) -> tuple[int, int]:
    """Return the first and last bin of the run above `level` around the peak; gaps of up to two bins belong to it."""
    high = np.flatnonzero(counts > level)
    at = int(np.searchsorted(high, peak))
    breaks = np.flatnonzero(np.diff(high) > 3)
    before, after = breaks[breaks < at], breaks[breaks >= at]
    return int(high[before[-1] + 1 if before.size else 0]), int(high[after[0] if after.size else -1])


class _Triggers:
    """Flashes in the triggers of a photodiode."""

    what = "triggers"

    def __init__(self, times: np.ndarray) -> None:
        self.times, self.count = times, times.size

    def coarse(self, host: np.ndarray, rising: np.ndarray) -> list[float]:
        """Return likely values of camera time minus host time (µs), where flashes correlate with triggers."""
        counts = np.bincount(((self.times - self.times[0]) // BIN).astype(np.int64))
        near = np.convolve(counts > 0, np.ones(SMEAR), "full")[SMEAR - 1 :]
        return [float(self.times[0]) + place for place in _pattern(near, host, rising)]

    def near(self, expected: float, rising: bool, near: float) -> float:
        """Return the time of the trigger nearest to `expected`; NaN if none is within `near` µs."""
        distance = np.abs(self.times - expected)
        best = int(distance.argmin())
        return float(self.times[best]) if distance[best] <= near else float("nan")


def _pattern(rate: np.ndarray, host: np.ndarray, rising: np.ndarray) -> list[float]:
    """Return the shifts at which `rate` correlates best with the flashes: µs since its first bin, minus host time."""
    steps = np.rint((host - host[0]) / BIN).astype(np.int64)
    # some flashes may be before the first event and after the last one
    around = np.zeros(int(steps[-1]) + SMEAR)
    padded = np.concatenate((around, rate, around))
    places = np.arange(padded.size - int(steps[-1]))
    score = np.zeros(places.size)
    for step, sign in zip(steps, np.where(rising, 1.0, -1.0), strict=True):
        score += sign * padded[places + step]
    found = []
    for _ in range(PLACES):
        best = int(score.argmax())
        found.append(float((best - around.size) * BIN - host[0]))
        score[max(best - 4 * SMEAR, 0) : best + 4 * SMEAR] = -np.inf
    return found


def _line(host: np.ndarray, camera: np.ndarray, rising: np.ndarray) -> tuple[float, float, float, int]:
    """Return offset and slope of the line near most flashes, the median distance of these from it, and their number."""
    middle = host.mean()
    columns = np.stack((np.ones(host.size), host - middle, np.where(rising, 0.5, -0.5)), 1)
    if rising.all() or not rising.any():
        columns = columns[:, :2]
    good = _agreeing(host - middle, camera - middle, rising)
    for _ in range(12):
        solution, *_ = np.linalg.lstsq(columns[good], camera[good], rcond=None)
        away = np.abs(camera - columns @ solution)
        kept = away <= max(4 * float(np.median(away[good])), LOOSE)
        if (kept == good).all() or kept.sum() < 6:
            break
        good = kept
    return (
        float(solution[0] - solution[1] * middle),
        float(solution[1]),
        float(np.median(away[good])),
        int(good.sum()),
    )


def _agreeing(host: np.ndarray, camera: np.ndarray, rising: np.ndarray) -> np.ndarray:
    """Return the mask of the flashes near a line: of all lines through two flashes, the one with most flashes nearby.

    ON and OFF may have different delays.
    """
    best = np.ones(host.size, bool)
    most = 0
    for i, j in combinations(range(host.size), 2):
        span = host[j] - host[i]
        # two flashes close together don't determine a slope
        if rising[i] != rising[j] or span < 0.4 * np.ptp(host):
            continue
        slope = (camera[j] - camera[i]) / span
        if abs(slope - 1) > 2 * MOST_DRIFT:
            continue
        away = camera - camera[i] - slope * (host - host[i])
        others = rising != rising[i]
        if others.any():
            away[others] -= np.median(away[others])
        kept = np.abs(away) <= LOOSE
        if kept.sum() > most:
            best, most = kept, int(kept.sum())
    return best
