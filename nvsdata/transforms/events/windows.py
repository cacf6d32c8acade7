"""Windows in time, for which only a part of a `Recording` is decoded, and the window length of a pipeline."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, ClassVar

from nvsdata.common.validation import microseconds, whole, whole_microseconds
from nvsdata.data.events import Events, check_window
from nvsdata.data.recording import Recording, as_events
from nvsdata.transforms.compose import Compose, Each
from nvsdata.transforms.rng import window_start

T_VOL = 33_333  # µs, 1/30 s: duration of each window of a sequence (T_vol in the thesis, section 5.3.1)


@dataclass(frozen=True)
class Window:
    """Cut a fixed window in time.

    Args:
        start: Start of the window in µs since the first event of the recording.
        stop: End of the window in µs since the first event of the recording; excluded.

    Returns:
        `Events`, without any event if the window is outside the recording. The call takes `Events` or a `Recording`, of
        which only the window is decoded.

    Raises:
        ValueError: A setting isn't an integer, or `stop` is before `start`.

    Example:
        >>> from nvsdata import Events, transforms as T
        >>> T.Window(0, 20)(Events([500, 510, 530], [1, 2, 3], [1, 1, 1], [1, 0, 1])).t.tolist()
        [500, 510]
    """

    start: int
    stop: int
    deterministic: ClassVar[bool] = True

    def __post_init__(self) -> None:
        for name in ("start", "stop"):
            whole_microseconds(name, getattr(self, name))
        check_window(self.start, self.stop)

    def __call__(self, sample: Events | Recording) -> Events:
        first, _ = _span(sample)
        return _cut(sample, first + int(self.start), first + int(self.stop))


@dataclass(frozen=True)
class RandomWindow:
    """Cut a window at a random time, completely inside the recording if it fits.

    Args:
        duration: Duration of the window in µs (default 30,000, as in the thesis).
        within: (low, high), the part of the range of possible start times from which the start is sampled: (0, 1)
            (default) is the entire range, (0, 0.2) the first fifth. Several such parts spread windows over the
            recording.

    Returns:
        `Events`. The call takes `Events` or a `Recording`, of which only the window is decoded.

    Raises:
        ValueError: A setting is out of range.

    Example:
        >>> import nvsdata
        >>> from nvsdata import transforms as T
        >>> len(T.RandomWindow(10_000)(nvsdata.example())) < len(nvsdata.example())
        True
    """

    duration: int = 30_000
    within: tuple[float, float] = (0.0, 1.0)

    def __post_init__(self) -> None:
        microseconds("duration", self.duration)
        if not 0 <= self.within[0] < self.within[1] <= 1:
            raise ValueError(f"within must be (low, high) with 0 <= low < high <= 1, not {self.within}")

    def __call__(self, sample: Events | Recording) -> Events:
        duration, (first, last) = int(self.duration), _span(sample)
        starts = max(last + 1 - duration - first, 0) + 1
        # products of large numbers are rounded, maybe upwards
        low = min(int(self.within[0] * starts), starts - 1)
        high = min(max(int(self.within[1] * starts), low + 1), starts)
        start = first + low + window_start(high - low)
        return _cut(sample, start, start + duration)

    def longest(self, sample: Events | Recording) -> int:
        """Return the longest duration in µs that isn't cut off at the end of the sample."""
        first, last = _span(sample)
        return last + 1 - first


@dataclass(frozen=True)
class RandomWindows:
    """Cut a window at a random time in each of `count` equal parts of the recording (thesis, section 5.2.1).

    The windows don't overlap if `count` of them fit. Otherwise they are spread evenly from the beginning of the
    recording to its end, and all neighbors overlap by the same time, up to 1 µs. (The thesis requires T_vol < T / S,
    where T is the time from the first event to the last. But its Table 5.1 has 8 windows of 1/30 s in 0.25 s.) If the
    recording is shorter than one window, each window is the entire recording.

    Args:
        count: Number of windows (default 8). The thesis calls it S and uses 8 and 16.
        duration: Duration of each window in µs (default 33,333). The thesis calls it T_vol and uses 1/30 s.

    Returns:
        List of `Events` in order of time. The call takes `Events` or a `Recording`, of which only the windows are
        decoded.

    Raises:
        ValueError: A setting isn't a positive integer.

    Example:
        >>> import nvsdata
        >>> from nvsdata import transforms as T
        >>> len(T.RandomWindows(8, 20_000)(nvsdata.example()))
        8
    """

    count: int = 8
    duration: int = T_VOL

    def __post_init__(self) -> None:
        whole("count", self.count, 1)
        microseconds("duration", self.duration)

    def __call__(self, sample: Events | Recording) -> list[Events]:
        duration, (first, last) = int(self.duration), _span(sample)
        starts = _starts(last + 1 - first, int(self.count), duration)
        return [_cut(sample, first + start, first + start + duration) for start in starts]

    def longest(self, sample: Events | Recording) -> int:
        """Return the longest duration in µs with which the windows of the sample don't overlap; at least 1."""
        first, last = _span(sample)
        return max((last + 1 - first) // self.count, 1)


def window_length(transform: Any) -> int | None:
    """Return the duration of the random windows that a pipeline cuts.

    Args:
        transform: A transform, or a `Compose`, of which the last `RandomWindow` or `RandomWindows` counts.

    Returns:
        The duration in µs, or None if the pipeline has neither `RandomWindow` nor `RandomWindows`.

    Example:
        >>> from nvsdata import transforms as T
        >>> T.window_length(T.Compose([T.RandomWindow(20_000), T.EventImage()]))
        20000
    """
    steps = _steps(transform)
    at = _last_window(steps)
    return None if at is None else int(steps[at].duration)


def with_window_length(transform: Any, duration: int) -> Compose:
    """Return a pipeline that cuts windows of another duration, everything else unchanged.

    Args:
        transform: See `window_length`.
        duration: New duration in µs.

    Raises:
        ValueError: The pipeline cuts no random windows.

    Example:
        >>> from nvsdata import transforms as T
        >>> T.with_window_length(T.RandomWindow(20_000), 5_000)
        Compose([RandomWindow(duration=5000, within=(0.0, 1.0))])
    """
    steps = _steps(transform)
    at = _required(steps, transform)
    return Compose([*steps[:at], replace(steps[at], duration=duration), *steps[at + 1 :]])


def after_window(transform: Any, step: Callable[[Events], Any], *, last: bool = False) -> Compose:
    """Return a pipeline with another step right after its random windows, applied to each window.

    `last` is True to leave out the steps that follow.
    """
    steps = _steps(transform)
    at = _required(steps, transform) + 1
    each = Each(step) if isinstance(steps[at - 1], RandomWindows) else step
    return Compose([*steps[:at], each, *([] if last else steps[at:])])


def longest_window(transform: Any, sample: Any) -> int:
    """Return the longest duration in µs of the windows that a pipeline can cut from a recording.

    Args:
        transform: See `window_length`.
        sample: `Events` or a `Recording`.

    Raises:
        ValueError: The pipeline cuts no random windows.

    Example:
        >>> from nvsdata import Events, transforms as T
        >>> T.longest_window(T.RandomWindow(20_000), Events([0, 99], [1, 2], [1, 1], [1, 0]))
        100
    """
    steps = _steps(transform)
    at = _required(steps, transform)
    longest: int = steps[at].longest(Compose(steps[:at])(sample))
    return longest


def _steps(transform: Any) -> list[Any]:
    return list(transform.transforms) if isinstance(transform, Compose) else [transform]


def _last_window(steps: list[Any]) -> int | None:
    return max((i for i, step in enumerate(steps) if isinstance(step, RandomWindow | RandomWindows)), default=None)


def _required(steps: list[Any], transform: Any) -> int:
    at = _last_window(steps)
    if at is None:
        raise ValueError(f"a pipeline with RandomWindow or RandomWindows is needed, not {transform!r}")
    return at


def _starts(total: int, count: int, duration: int) -> list[int]:
    """Return the starts of `count` windows of `duration` µs, in µs from the beginning of a recording of `total` µs.

    If they fit without overlap, each starts at a random time in one of `count` equal parts. Otherwise they are
    evenly spaced and overlap.
    """
    if count * duration > total:
        gaps = max(count - 1, 1)
        return [max(total - duration, 0) * n // gaps for n in range(count)]
    edges = [total * n // count for n in range(count + 1)]
    return [start + window_start(stop - start - duration + 1) for start, stop in pairwise(edges)]


def _span(sample: Events | Recording) -> tuple[int, int]:
    if isinstance(sample, Recording):
        return sample.span
    t = as_events(sample).t
    return (int(t[0]), int(t[-1])) if t.size else (0, 0)


def _cut(sample: Events | Recording, start: int, stop: int) -> Events:
    return sample.read(start, stop) if isinstance(sample, Recording) else sample.window(start, stop)
