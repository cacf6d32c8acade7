"""Transforms that change or select the polarity of events."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from nvsdata.common.validation import probability
from nvsdata.data.events import Events
from nvsdata.transforms.apply import map_sample
from nvsdata.transforms.rng import uniform


@dataclass(frozen=True)
class SelectPolarity:
    """Keep the events of one polarity.

    Args:
        polarity: 1 (default) keeps ON events, 0 OFF events.

    Returns:
        `Events`. The call takes `Events`, a `Recording` or a list of them.

    Raises:
        ValueError: `polarity` is neither 0 nor 1.

    Example:
        >>> from nvsdata import Events, transforms as T
        >>> T.SelectPolarity(1)(Events([0, 10], [1, 2], [1, 1], [1, 0])).t.tolist()
        [0]
    """

    polarity: int = 1
    deterministic: ClassVar[bool] = True

    def __post_init__(self) -> None:
        if self.polarity not in (0, 1):
            raise ValueError(f"polarity must be 0 or 1, not {self.polarity}")

    def __call__(self, sample: Any) -> Any:
        return map_sample(sample, lambda events: events.of(events.columns.take(events.p == self.polarity)))


@dataclass(frozen=True)
class MergePolarities:
    """Make all events ON events, for sensors or networks that don't distinguish polarities.

    Returns:
        `Events`. The call takes `Events`, a `Recording` or a list of them.

    Example:
        >>> from nvsdata import Events, transforms as T
        >>> T.MergePolarities()(Events([0, 10], [1, 2], [1, 1], [1, 0])).p.tolist()
        [1, 1]
    """

    deterministic: ClassVar[bool] = True

    def __call__(self, sample: Any) -> Any:
        return map_sample(sample, lambda events: _with(events, np.ones_like(events.p)))


@dataclass(frozen=True)
class RandomPolarityFlip:
    """Swap ON and OFF with probability `p`.

    Args:
        p: Probability (default 0.5); 1 always swaps them.

    Returns:
        `Events`. The call takes `Events`, a `Recording` or a list of them, of which all or none are swapped.

    Raises:
        ValueError: `p` isn't a probability.

    Example:
        >>> from nvsdata import Events, transforms as T
        >>> T.RandomPolarityFlip(p=1)(Events([0, 10], [1, 2], [1, 1], [1, 0])).p.tolist()
        [0, 1]
    """

    p: float = 0.5

    def __post_init__(self) -> None:
        probability("p", self.p)

    def __call__(self, sample: Any) -> Any:
        flipped = uniform(0, 1) < self.p
        return map_sample(sample, lambda events: _with(events, 1 - events.p) if flipped else events)


def _with(events: Events, p: np.ndarray) -> Events:
    return events.of(events.columns._replace(p=p))
