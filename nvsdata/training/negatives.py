"""Objects whose parts are moved as further samples of a background class."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from nvsdata.common.validation import probability
from nvsdata.data.events import Columns, Events
from nvsdata.transforms.compose import Compose
from nvsdata.transforms.events.windows import after_window
from nvsdata.transforms.rng import randint, uniform


@dataclass(frozen=True)
class MovedParts:
    """Flip events from top to bottom, or roll them around in y or in both directions, at random.

    Rolling by a quarter to three quarters of the rectangle around the events moves the part that leaves it on one side
    to the other side. The numbers and times of events remain.
    """

    def __call__(self, events: Events) -> Events:
        if not len(events):
            return events
        kind = randint(3)
        x, y = events.x.astype(np.int64), events.y.astype(np.int64)
        y = y.min() + y.max() - y if kind == 0 else _rolled(y)
        x = _rolled(x) if kind == 2 else x
        return events.of(Columns(events.t, x.astype(np.int16), y.astype(np.int16), events.p))


def _rolled(values: np.ndarray) -> np.ndarray:
    first, size = values.min(), values.max() - values.min() + 1
    rolled: np.ndarray = first + (values - first + int(size * uniform(0.25, 0.75))) % size
    return rolled


@dataclass(frozen=True)
class Negatives:
    """Make some training samples of objects to samples of the background, by moving their parts.

    A network otherwise learns that dense texture is an object, if backgrounds of the training data have few events.
    It is a function of recording and target, such as datasets take as `transforms`.

    Args:
        transform: Transform from a recording to the network's input, with random windows.
        background: Number of the background class.
        fraction: Probability that a sample of another class becomes one of the background (default 0.4).

    Raises:
        ValueError: `fraction` isn't a probability.

    Example:
        >>> import nvsdata
        >>> from nvsdata import training, transforms as T
        >>> pipeline = T.Compose([T.RandomWindow(30_000), T.EventImage()])
        >>> training.Negatives(pipeline, background=0, fraction=1)(nvsdata.example(), 3)[1]
        0
    """

    transform: Compose
    background: int
    fraction: float = 0.4

    def __post_init__(self) -> None:
        probability("fraction", self.fraction)

    def __call__(self, recording: Any, target: int) -> tuple[Any, int]:
        if target != self.background and uniform(0, 1) < self.fraction:
            return after_window(self.transform, MovedParts())(recording), self.background
        return self.transform(recording), target
