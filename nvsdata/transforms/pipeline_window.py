"""Pipelines with windows of another length: the same network, shown more or less of a recording."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from nvsdata.transforms.compose import Compose
from nvsdata.transforms.events.windows import RandomWindow, Volumes


def window_length(transform: Any) -> int | None:
    """The duration in µs of the windows that a pipeline shows to a network; None if it cuts none.

    - `transform`: a transform, or a `Compose`, of which the last `RandomWindow` or `Volumes` counts
    """
    steps = _steps(transform)
    at = _last_window(steps)
    return None if at is None else int(steps[at].duration)


def with_window_length(transform: Any, duration: int) -> Compose:
    """The pipeline with windows of `duration` µs, everything else unchanged. ValueError if it cuts no windows."""
    steps = _steps(transform)
    at = _needed(steps, transform)
    return Compose([*steps[:at], replace(steps[at], duration=duration), *steps[at + 1 :]])


def longest_window(transform: Any, sample: Any) -> int:
    """The longest window in µs for which a pipeline finds room in a recording. ValueError if it cuts no windows."""
    steps = _steps(transform)
    at = _needed(steps, transform)
    longest: int = steps[at].longest(Compose(steps[:at])(sample))
    return longest


def _steps(transform: Any) -> list[Any]:
    return list(transform.transforms) if isinstance(transform, Compose) else [transform]


def _last_window(steps: list[Any]) -> int | None:
    return max((i for i, step in enumerate(steps) if isinstance(step, RandomWindow | Volumes)), default=None)


def _needed(steps: list[Any], transform: Any) -> int:
    at = _last_window(steps)
    if at is None:
        raise ValueError(f"a pipeline with RandomWindow or Volumes is needed, not {transform!r}")
    return at
