"""Windows in time; in a Recording only the window is decoded."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import ClassVar

from nvsdata.common.validation import microseconds, whole, whole_microseconds
from nvsdata.data.events import Events, check_window
from nvsdata.data.recording import Recording, as_events
from nvsdata.transforms.defaults import T_VOL
from nvsdata.transforms.rng import place


@dataclass(frozen=True)
class Window:
    """The events of a fixed window in time.

    - `start`, `stop`: in µs since the first event of the recording; `stop` is excluded

    Takes `Events` or a `Recording`, gives `Events`, none if the window lies outside. ValueError unless both are whole
    µs and `start` is not after `stop`.
    """

    start: int
    stop: int
    deterministic: ClassVar[bool] = True

    def __post_init__(self) -> None:
        for name in ("start", "stop"):
            whole_microseconds(name, getattr(self, name))
        check_window(self.start, self.stop)

    def __call__(self, sample: Events | Recording) -> Events:
        return window(sample, int(self.start), int(self.stop))


@dataclass(frozen=True)
class RandomWindow:
    """The events of a window at a random place, completely inside the recording if it fits.

    - `duration`: in µs (default 30,000, as in the thesis)
    - `within`: (low, high), the share of possible start times from which one is drawn: (0, 1) (default) is all,
      (0, 0.2) the first fifth. With several such shares, windows are spread over the recording.

    Takes `Events` or a `Recording`, gives `Events`. ValueError for settings out of range.
    """

    duration: int = 30_000
    within: tuple[float, float] = (0.0, 1.0)

    def __post_init__(self) -> None:
        microseconds("duration", self.duration)
        if not 0 <= self.within[0] < self.within[1] <= 1:
            raise ValueError(f"within must be (low, high) with 0 <= low < high <= 1, not {self.within}")

    def __call__(self, sample: Events | Recording) -> Events:
        return random_window(sample, int(self.duration), within=self.within)

    def longest(self, sample: Events | Recording) -> int:
        """The longest duration that isn't cut off at the sample's end, in µs."""
        first, last = _span(sample)
        return last + 1 - first


@dataclass(frozen=True)
class Volumes:
    """`count` windows that don't overlap, one at a random place in each of `count` equal parts (thesis 5.2.1).

    - `count`: number of windows (default 8); the thesis's S, 8 or 16
    - `duration`: of each in µs (default 33,333); the thesis's T_vol, 1/30 s

    The thesis asks for T_vol < T / S, where T is the time from the first event to the last. A recording for which
    `count` windows are too long has no choice of places: they are spread evenly from its beginning to its end, and
    neighbors overlap by the same time, to 1 µs. So it is with Table 5.1's 8 windows of 1/30 s in 0.25 s. If the
    recording is shorter than one window, each of them is the whole recording.

    Takes `Events` or a `Recording`, of which only these windows are decoded; gives a list of `Events` in order of time.
    ValueError for settings that aren't positive.
    """

    count: int = 8
    duration: int = T_VOL

    def __post_init__(self) -> None:
        whole("count", self.count, 1)
        microseconds("duration", self.duration)

    def __call__(self, sample: Events | Recording) -> list[Events]:
        return volumes(sample, int(self.count), int(self.duration))

    def longest(self, sample: Events | Recording) -> int:
        """The longest duration that stays within a part of the sample, in µs; at least 1."""
        first, last = _span(sample)
        return max((last + 1 - first) // self.count, 1)


def volumes(sample: Events | Recording, count: int = 8, duration: int = T_VOL) -> list[Events]:
    """Windows spread over the recording, which overlap only if they don't fit; see `Volumes`."""
    first, last = _span(sample)
    starts = _apart(last + 1 - first, count, duration)
    return [_cut(sample, first + start, first + start + duration) for start in starts]


def _apart(total: int, count: int, duration: int) -> list[int]:
    """Where `count` windows of `duration` begin, in `total` µs: at random if they fit, else at equal distances."""
    if count * duration > total:
        gaps = max(count - 1, 1)
        return [max(total - duration, 0) * n // gaps for n in range(count)]
    edges = [total * n // count for n in range(count + 1)]
    return [start + place(stop - start - duration + 1) for start, stop in pairwise(edges)]


def window(sample: Events | Recording, start: int, stop: int) -> Events:
    """Events with start <= t - t_first < stop; none if the window lies outside. See `Window`."""
    check_window(start, stop)
    first, _ = _span(sample)
    return _cut(sample, first + start, first + stop)


def random_window(
    sample: Events | Recording, duration: int = 30_000, *, within: tuple[float, float] = (0.0, 1.0)
) -> Events:
    """Events of a random window of `duration` µs; see `RandomWindow`."""
    first, last = _span(sample)
    places = max(last + 1 - duration - first, 0) + 1
    # products of large numbers are rounded, maybe upwards
    low = min(int(within[0] * places), places - 1)
    high = min(max(int(within[1] * places), low + 1), places)
    start = first + low + place(high - low)
    return _cut(sample, start, start + duration)


def _span(sample: Events | Recording) -> tuple[int, int]:
    if isinstance(sample, Recording):
        return sample.span
    t = as_events(sample).t
    return (int(t[0]), int(t[-1])) if t.size else (0, 0)


def _cut(sample: Events | Recording, start: int, stop: int) -> Events:
    return sample.read(start, stop) if isinstance(sample, Recording) else sample.window(start, stop)
