"""Changes of polarity."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from nvsdata.common.validation import probability
from nvsdata.data.events import Events
from nvsdata.transforms.apply import change_all
from nvsdata.transforms.rng import uniform


@dataclass(frozen=True)
class SelectPolarity:
    """Keep the events of one polarity.

    - `polarity`: 1 (default) keeps ON events, 0 OFF events

    Takes `Events`, a `Recording` or a list of them, gives `Events`. ValueError for any other polarity.
    """

    polarity: int = 1
    deterministic: ClassVar[bool] = True

    def __post_init__(self) -> None:
        if self.polarity not in (0, 1):
            raise ValueError(f"polarity must be 0 or 1, not {self.polarity}")

    def __call__(self, sample: Any) -> Any:
        return change_all(sample, lambda events: events.of(events.columns.take(events.p == self.polarity)))


@dataclass(frozen=True)
class MergePolarities:
    """OFF events become ON events, for sensors or networks that don't tell them apart.

    Takes `Events`, a `Recording` or a list of them, gives `Events`.
    """

    deterministic: ClassVar[bool] = True

    def __call__(self, sample: Any) -> Any:
        return change_all(sample, lambda events: _with(events, np.ones_like(events.p)))


@dataclass(frozen=True)
class RandomPolarityFlip:
    """ON becomes OFF, and OFF becomes ON, with probability `p`.

    - `p`: probability (default 0.5)

    Takes `Events`, a `Recording` or a list of them, flipped together; gives `Events`. ValueError unless `p` is a
    probability.
    """

    p: float = 0.5

    def __post_init__(self) -> None:
        probability("p", self.p)

    def __call__(self, sample: Any) -> Any:
        flipped = uniform(0, 1) < self.p
        return change_all(sample, flip_polarity if flipped else lambda events: events)


def flip_polarity(events: Events) -> Events:
    """Events of the other polarity."""
    return _with(events, 1 - events.p)


def _with(events: Events, p: np.ndarray) -> Events:
    return events.of(events.columns._replace(p=p))
