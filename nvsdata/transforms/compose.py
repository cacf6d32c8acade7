"""Transforms that apply others: one after the other, to each part of a list, or at random."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from nvsdata.common import validation
from nvsdata.data.boxes import Boxes
from nvsdata.data.recording import wrong_type
from nvsdata.transforms.apply import boxes_part_ways, with_boxes
from nvsdata.transforms.rng import randint, uniform


@dataclass(frozen=True, repr=False)
class Compose:
    """Apply transforms one after the other.

    Args:
        transforms: List of callables, each of which takes the result of the one before.

    Raises:
        TypeError: `transforms` isn't a list, or one of them isn't callable. A TypeError, AttributeError or MemoryError
            in a step gets a note that names the step.

    Example:
        >>> import nvsdata
        >>> from nvsdata import transforms as T
        >>> pipeline = T.Compose([T.RandomWindow(30_000), T.EventImage()])
        >>> pipeline(nvsdata.example()).shape
        torch.Size([2, 180, 240])
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
                _note(error, number, transform, sample)
                raise
        return sample

    def with_boxes(self, sample: Any, boxes: Boxes) -> tuple[Any, Boxes]:
        """Return the result, and the boxes after all steps that move the sample."""
        for number, transform in enumerate(self.transforms, 1):
            try:
                sample, boxes = with_boxes(transform, sample, boxes)
            except (TypeError, AttributeError, MemoryError) as error:
                _note(error, number, transform, sample)
                raise
        return sample, boxes

    @property
    def deterministic(self) -> bool:
        """True if equal samples have equal results. A subclass must declare it itself."""
        return type(self) is Compose and all(map(is_deterministic, self.transforms))

    def __repr__(self) -> str:
        return f"Compose([{', '.join(map(repr, self.transforms))}])"


@dataclass(frozen=True)
class Each:
    """Apply a transform to each element of a list, such as the windows of `RandomWindows`.

    Args:
        transform: Any callable.

    Returns:
        The list of results.

    Raises:
        TypeError: The transform isn't callable, or the sample isn't a list or tuple.

    Example:
        >>> import nvsdata
        >>> from nvsdata import transforms as T
        >>> pipeline = T.Compose([T.RandomWindows(8, 33_333), T.Each(T.NonUniformSample(8))])
        >>> len(pipeline(nvsdata.example()))
        8
    """

    transform: Callable[[Any], Any]

    def __post_init__(self) -> None:
        validation.transform(self.transform)

    def __call__(self, samples: Iterable[Any]) -> list[Any]:
        return [self.transform(sample) for sample in _listed(samples)]

    def with_boxes(self, samples: Iterable[Any], boxes: Boxes) -> tuple[list[Any], Boxes]:
        """Return the list of results, and the boxes. ValueError if they move differently for different elements."""
        made = [with_boxes(self.transform, sample, boxes) for sample in _listed(samples)]
        if any(not moved.equal(made[0][1]) for _, moved in made):
            raise boxes_part_ways(f"{self.transform!r} applied to each part of a sample")
        return [result for result, _ in made], made[0][1] if made else boxes

    @property
    def deterministic(self) -> bool:
        """True if equal samples have equal results. A subclass must declare it itself."""
        return type(self) is Each and is_deterministic(self.transform)


@dataclass(frozen=True)
class RandomApply:
    """Apply a transform with probability `p`, and otherwise leave the sample as it is.

    Args:
        transform: Any callable.
        p: Probability (default 0.5).

    Raises:
        TypeError: The transform isn't callable.
        ValueError: `p` isn't a probability.

    Example:
        >>> import nvsdata
        >>> from nvsdata import transforms as T
        >>> len(T.RandomApply(T.SelectPolarity(1), p=1)(nvsdata.example())) < len(nvsdata.example())
        True
    """

    transform: Callable[[Any], Any]
    p: float = 0.5

    def __post_init__(self) -> None:
        validation.transform(self.transform)
        validation.probability("p", self.p)

    def __call__(self, sample: Any) -> Any:
        return self.transform(sample) if self._applies() else sample

    def with_boxes(self, sample: Any, boxes: Boxes) -> tuple[Any, Boxes]:
        """Return the sample and its boxes, both changed or both as they are."""
        return with_boxes(self.transform, sample, boxes) if self._applies() else (sample, boxes)

    def _applies(self) -> bool:
        return uniform(0, 1) < self.p


@dataclass(frozen=True)
class RandomChoice:
    """Apply one of several transforms, each with the same probability.

    Args:
        transforms: List of callables, at least one.

    Raises:
        TypeError: A transform isn't callable.
        ValueError: The list is empty.

    Example:
        >>> import nvsdata
        >>> from nvsdata import transforms as T
        >>> drop = T.RandomChoice([T.DropByTime(0.2), T.DropByArea(0.2)])
        >>> len(drop(nvsdata.example())) < len(nvsdata.example())
        True
    """

    transforms: Sequence[Callable[[Any], Any]]

    def __post_init__(self) -> None:
        if not self.transforms:
            raise ValueError("RandomChoice needs at least one transform")
        for transform in self.transforms:
            validation.transform(transform)

    def __call__(self, sample: Any) -> Any:
        return self._chosen()(sample)

    def with_boxes(self, sample: Any, boxes: Boxes) -> tuple[Any, Boxes]:
        """Return the sample and its boxes after one of the transforms."""
        return with_boxes(self._chosen(), sample, boxes)

    def _chosen(self) -> Callable[[Any], Any]:
        return self.transforms[randint(len(self.transforms))]


def is_deterministic(transform: object) -> bool:
    """Return True if a transform declares that equal samples have equal results."""
    return bool(getattr(transform, "deterministic", False))


def head_and_tail(transform: Callable[[Any], Any] | None) -> tuple[Compose, Compose]:
    """Return the first, deterministic transforms of a pipeline, and all others; every nested Compose is flattened."""
    steps = _steps(transform)
    cut = next((i for i, step in enumerate(steps) if not is_deterministic(step)), len(steps))
    return Compose(steps[:cut]), Compose(steps[cut:])


def _steps(transform: Callable[[Any], Any] | None) -> list[Callable[[Any], Any]]:
    if transform is None:
        return []
    # a subclass of Compose may call its transforms differently
    if type(transform) is not Compose:
        return [transform]
    return [step for part in transform.transforms for step in _steps(part)]


def _note(error: Exception, number: int, transform: Any, sample: Any) -> None:
    """Add a note that names the step that raised an error."""
    error.add_note(f"in step {number} of the pipeline, {transform!r}, given {type(sample).__name__}")


def _listed(samples: Any) -> Sequence[Any]:
    if not isinstance(samples, list | tuple):
        raise wrong_type("samples", "a list, such as RandomWindows returns", samples)
    return samples
