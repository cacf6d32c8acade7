"""Several transforms as one."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from nvsdata.common import validation
from nvsdata.data.recording import wrong_type
from nvsdata.transforms.apply import each


@dataclass(frozen=True)
class Each:
    """Apply a transform to each element of a list, such as the windows of `Volumes`; gives a list of results.

    - `transform`: any callable

    TypeError for a transform that isn't callable, and samples that aren't a list or tuple.
    """

    transform: Callable[[Any], Any]

    def __post_init__(self) -> None:
        validation.transform(self.transform)

    def __call__(self, samples: Iterable[Any]) -> list[Any]:
        if not isinstance(samples, list | tuple):
            raise wrong_type("a list, such as Volumes gives", samples)
        return each(self.transform, samples)

    @property
    def deterministic(self) -> bool:
        """Whether the same sample always gives the same result; a subclass must declare it itself."""
        return type(self) is Each and is_deterministic(self.transform)


@dataclass(frozen=True, repr=False)
class Compose:
    """Apply transforms one after the other.

    - `transforms`: list of callables, each of which takes the result of the one before

    TypeError for anything else. A TypeError, AttributeError or MemoryError in a step gets a note that names the step.
    """

    transforms: Sequence[Callable[[Any], Any]]

    def __post_init__(self) -> None:
        if not isinstance(self.transforms, list | tuple):
            raise TypeError(f"Compose takes a list of transforms, not {self.transforms!r}")
        for transform in self.transforms:
            validation.transform(transform)

    def __call__(self, sample: Any) -> Any:
        for number, transform in enumerate(self.transforms, 1):
            try:
                sample = transform(sample)
            except (TypeError, AttributeError, MemoryError) as error:
                error.add_note(f"in step {number} of the pipeline, {transform!r}, given {type(sample).__name__}")
                raise
        return sample

    @property
    def deterministic(self) -> bool:
        """Whether the same sample always gives the same result; a subclass must declare it itself."""
        return type(self) is Compose and all(map(is_deterministic, self.transforms))

    def __repr__(self) -> str:
        return f"Compose([{', '.join(map(repr, self.transforms))}])"


def is_deterministic(transform: object) -> bool:
    """Whether a transform says of itself that the same sample always gives the same result."""
    return bool(getattr(transform, "deterministic", False))
