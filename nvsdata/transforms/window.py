"""Windows in time: of a Recording only the window is decoded."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from nvsdata.events import Events, Recording, check_window
from nvsdata.transforms.checks import below, positive


@dataclass(frozen=True)
class Window:
    """Events from `start` to `stop` (excluded), in µs since the first event of the recording."""

    start: int
    stop: int
    deterministic: ClassVar[bool] = True

    def __post_init__(self) -> None:
        check_window(self.start, self.stop)

    def __call__(self, sample: Events | Recording) -> Events:
        return window(sample, self.start, self.stop)


@dataclass(frozen=True)
class RandomWindow:
    """A window of `duration` µs at a random place, wholly inside the recording if it fits (thesis: 30 ms).

    It begins within the share `within` of the places where it may: (0, 1) is anywhere, (0, 0.2) the
    first fifth. Windows of several such shares spread over the recording.
    """

    duration: int = 30_000
    within: tuple[float, float] = (0.0, 1.0)

    def __post_init__(self) -> None:
        positive("duration", self.duration)
        if not 0 <= self.within[0] < self.within[1] <= 1:
            raise ValueError(f"within must be (low, high) with 0 <= low < high <= 1, not {self.within}")

    def __call__(self, sample: Events | Recording) -> Events:
        return random_window(sample, self.duration, within=self.within)


def window(sample: Events | Recording, start: int, stop: int) -> Events:
    """Events with start <= t - t_first < stop; empty where the window lies outside. See `Window`."""
    check_window(start, stop)
    first, _ = _span(sample)
    return _cut(sample, first + start, first + stop)


def random_window(
    sample: Events | Recording, duration: int = 30_000, *, within: tuple[float, float] = (0.0, 1.0)
) -> Events:
    """Events of a window of `duration` µs that begins anywhere it still fits; see `RandomWindow`."""
    first, last = _span(sample)
    places = max(last + 1 - duration - first, 0) + 1
    low = int(within[0] * places)
    high = max(int(within[1] * places), low + 1)
    start = first + low + below(high - low)
    return _cut(sample, start, start + duration)


def _span(sample: Events | Recording) -> tuple[int, int]:
    if isinstance(sample, Recording):
        return sample.span
    return (int(sample.t[0]), int(sample.t[-1])) if len(sample) else (0, 0)


def _cut(sample: Events | Recording, start: int, stop: int) -> Events:
    return sample.read(start, stop) if isinstance(sample, Recording) else sample.window(start, stop)
