"""Host time and camera time, matched by flashes of a screen that the camera sees."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from nvsdata.events import Events

BIN = 1_000  # µs of the coarse search
SMEAR = 5  # bins that a flash's events spread over
NEAR = 12_000  # µs around where a flash is expected: less than a frame of 60 Hz
MOST_DRIFT = 500e-6  # of the camera's clock against the host's
LEAST = 0.6  # share of the flashes that must be found
LOOSE = 400.0  # µs that a flash may always be off the fit


def host_time() -> float:
    """The host's time in µs, on the clock that everything here is timed by."""
    return time.perf_counter() * 1e6


class NoSync(ValueError):
    """The flashes aren't in the events."""


@dataclass(frozen=True)
class Fit:
    """Camera time = `offset` + (1 + `drift`) x host time, µs.

    `residual` is the median distance of the flashes from it (µs), `used` how many of `flashes` agree with it.
    """

    offset: float
    drift: float
    residual: float
    used: int
    flashes: int

    def camera(self, host: float) -> float:
        """Camera time (µs) of a host time (µs)."""
        return self.offset + (1 + self.drift) * host

    def host(self, camera: float) -> float:
        """Host time (µs) of a camera time (µs)."""
        return (camera - self.offset) / (1 + self.drift)


def flashes(length: int = 31) -> np.ndarray:
    """Brightness, 0 or 1, of each step of the pattern: a shift register's, which no shift of it is like."""
    state, bits = 1, []
    for _ in range(length):
        bits.append(state & 1)
        state = state >> 1 | ((state ^ state >> 2) & 1) << 4
    return np.array(bits, np.uint8)


def fit(events: Events, shown: np.ndarray, bright: np.ndarray) -> Fit:
    """Match the flashes that were shown to the events that a camera saw of them.

    `shown` [n], host times (µs, rising) at which the whole screen changed, and `bright` [n], whether to bright (ON
    events) or to dark (OFF). They may be several groups, as before and after a video. A flash that came later than
    the host thought, or not at all, is an outlier and left out. NoSync if too few agree.

    The flashes are first found as a pattern by correlation at 1 ms, from the first group on, then each by the median
    time of its events, and a line is laid through those that agree. ON and OFF may have different delays, of which
    the mean is taken for the camera's.
    """
    host, rising = np.asarray(shown, np.float64), np.asarray(bright, bool)
    if host.size < 6 or len(events) == 0:
        raise NoSync(f"{host.size} flashes and {len(events)} events can't be matched")
    group = host - host[0] < 3e6
    offset = _coarse(events, host[group], rising[group])
    camera = np.full(host.size, np.nan)
    found = np.zeros(host.size, bool)
    for n in range(host.size):
        # after the first group the last flashes foretell the next one, with a doubt that grows with the time since
        last = np.flatnonzero(found)[-8:]
        ahead = offset if group[n] or not last.size else float(np.median(camera[last] - host[last]))
        gap = host[n] - (host[last[-1]] if last.size else host[0])
        camera[n] = _burst(events, host[n] + ahead, bool(rising[n]), NEAR + MOST_DRIFT * gap)
        found[n] = np.isfinite(camera[n])
    if found.sum() < max(6, LEAST * host.size):
        raise NoSync(f"of {host.size} flashes the camera saw {int(found.sum())}: is the whole screen in its view?")
    offset, slope, residual, used = _line(host[found], camera[found], rising[found])
    if used < LEAST * host.size:
        raise NoSync(f"of {host.size} flashes only {used} agree in time")
    if abs(slope - 1) > MOST_DRIFT:
        raise NoSync(f"a clock that is {abs(slope - 1) * 1e6:.0f} ppm off isn't this camera's")
    return Fit(offset, slope - 1, residual, used, host.size)


def _coarse(events: Events, host: np.ndarray, rising: np.ndarray) -> float:
    """Camera time minus host time, by correlation of the flashes with the rate of ON less OFF events."""
    first = int(events.t[0])
    bins = (events.t - first) // BIN
    rate = np.bincount(bins, np.where(events.p, 1.0, -1.0))
    # a burst counts by its size's root, or one bright object would outweigh the pattern
    rate = np.sign(rate) * np.sqrt(np.abs(rate))
    smooth = np.convolve(rate, np.ones(SMEAR), "full")[SMEAR - 1 :]
    steps = np.rint((host - host[0]) / BIN).astype(np.int64)
    # flashes may lie before the first event and after the last one by a little
    padded = np.concatenate((np.zeros(SMEAR), smooth, np.zeros(int(steps[-1]) + 1)))
    places = np.arange(padded.size - int(steps[-1]))
    score = np.zeros(places.size)
    for step, sign in zip(steps, np.where(rising, 1.0, -1.0), strict=True):
        score += sign * padded[places + step]
    # the pattern may come again, after the video: its first time is meant
    first_good = int(np.argmax(score >= 0.7 * score.max()))
    best = first_good + int(score[first_good : first_good + 4 * SMEAR].argmax())
    return float(first + (best - SMEAR) * BIN - host[0])


def _burst(events: Events, expected: float, rising: bool, near: float) -> float:
    """Median time of a flash's events around where it is expected; NaN if there is no flash."""
    lo, hi = np.searchsorted(events.t, (expected - near, expected + near + SMEAR * BIN))
    t, right = events.t[lo:hi], events.p[lo:hi] == rising
    t = t[right]
    if t.size < 20:
        return float("nan")
    counts = np.bincount((t - t[0]) // BIN)
    window = np.convolve(counts, np.ones(SMEAR), "full")[SMEAR - 1 :]
    peak = int(window.argmax())
    inside = t[(t >= t[0] + peak * BIN) & (t < t[0] + (peak + SMEAR) * BIN)]
    # far more than the noise of as long a time
    noise = (t.size - inside.size) / max(counts.size - SMEAR, 1) * SMEAR
    return float(np.median(inside)) if inside.size > 3 * noise + 10 else float("nan")


def _line(host: np.ndarray, camera: np.ndarray, rising: np.ndarray) -> tuple[float, float, float, int]:
    """Offset and slope of the line that most flashes lie on, the median distance from it, how many lie on it."""
    middle = host.mean()
    columns = np.stack((np.ones(host.size), host - middle, np.where(rising, 0.5, -0.5)), 1)
    if rising.all() or not rising.any():
        columns = columns[:, :2]
    good = np.ones(host.size, bool)
    for _ in range(12):
        solution, *_ = np.linalg.lstsq(columns[good], camera[good], rcond=None)
        away = np.abs(camera - columns @ solution)
        kept = away <= max(4 * float(np.median(away)), LOOSE)
        if (kept == good).all() or kept.sum() < 6:
            break
        good = kept
    return (
        float(solution[0] - solution[1] * middle),
        float(solution[1]),
        float(np.median(away[good])),
        int(good.sum()),
    )
