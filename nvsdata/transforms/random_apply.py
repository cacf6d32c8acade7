"""Transforms that are applied at random."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from nvsdata.common import validation
from nvsdata.common.validation import probability
from nvsdata.transforms.rng import randint, uniform


@dataclass(frozen=True)
class RandomApply:
    """Apply a transform with probability `p`; otherwise the sample stays as it is.

    - `transform`: any callable
    - `p`: probability (default 0.5)

    TypeError for a transform that isn't callable, ValueError unless `p` is a probability.
    """

    transform: Callable[[Any], Any]
    p: float = 0.5

    def __post_init__(self) -> None:
        validation.transform(self.transform)
        probability("p", self.p)

    def __call__(self, sample: Any) -> Any:
        return self.transform(sample) if uniform(0, 1) < self.p else sample


@dataclass(frozen=True)
class RandomChoice:
    """Apply one of several transforms, each with the same probability.

    - `transforms`: list of callables, at least one

    TypeError for a transform that isn't callable, ValueError for none.
    """

    transforms: Sequence[Callable[[Any], Any]]

    def __post_init__(self) -> None:
        if not self.transforms:
            raise ValueError("RandomChoice needs at least one transform")
        for transform in self.transforms:
            validation.transform(transform)

    def __call__(self, sample: Any) -> Any:
        return self.transforms[randint(len(self.transforms))](sample)
