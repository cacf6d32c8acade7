"""Functions that apply a change to all of a sample: to each part of a list, and to the boxes around objects."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Any, ClassVar

import torch

from nvsdata.data.boxes import Boxes
from nvsdata.data.events import Events
from nvsdata.data.graph import Graph
from nvsdata.data.recording import Recording, as_events, wrong_type

Change = Callable[[Any], Any]
"""Function that changes one part of a sample: `Events`, a graph, an image, or `Boxes`."""


class SpatialTransform(ABC):
    """Transform that moves events, nodes or pixels in the plane of the sensor.

    A subclass defines `_change`. Its instances take a sample alone, or with boxes (`with_boxes`); all parts of a list,
    and the boxes, get the same change.
    """

    graphs: ClassVar[bool] = False
    images: ClassVar[bool] = False

    @abstractmethod
    def _change(self, sample: Any) -> Change:
        """Return the function to apply to each part of a decoded sample, and to its boxes.

        All random numbers are sampled here.
        """

    def __call__(self, sample: Any) -> Any:
        sample = self._map(sample, lambda part: part)
        return self._map(sample, self._change(sample))

    def with_boxes(self, sample: Any, boxes: Boxes) -> tuple[Any, Boxes]:
        """Return the changed sample, and its boxes after the same change."""
        sample = self._map(sample, lambda part: part)
        change = self._change(sample)
        moved = move_boxes(sample, boxes, change)
        return self._map(sample, change), moved

    def _map(self, sample: Any, change: Change) -> Any:
        return map_sample(sample, change, graphs=self.graphs, images=self.images)


def map_sample(sample: Any, change: Change, *, graphs: bool = False, images: bool = False) -> Any:
    """Apply a change to a sample, or to each part of a list, such as `RandomWindows` returns.

    Args:
        sample: `Events`, a `Recording`, which is decoded, or a list of them.
        change: Function that is applied to `Events`, and to graphs and images if they are allowed.
        graphs: True to allow a `Graph`, alone or in a list (default False).
        images: True to allow a tensor [..., H, W], alone (default False).

    Returns:
        The result of `change`, or a list of results.

    Raises:
        TypeError: The sample is something else.
    """
    check_sample(sample, graphs=graphs, images=images)
    if isinstance(sample, list | tuple):
        return [map_sample(part, change, graphs=graphs) for part in sample]
    return change(as_events(sample) if isinstance(sample, Recording) else sample)


def check_sample(sample: Any, *, graphs: bool = False, images: bool = False) -> None:
    """Raise a TypeError unless `map_sample` takes the sample. The parts of a list aren't checked."""
    taken = (Events, Recording, list, tuple, Graph) if graphs else (Events, Recording, list, tuple)
    if isinstance(sample, taken) or (images and isinstance(sample, torch.Tensor) and sample.ndim >= 2):
        return
    others = ("a tensor [..., H, W], " if images else "") + ("a Graph, " if graphs else "")
    raise wrong_type("sample", f"{others}Events, a Recording or a list of them", sample)


def decoded(sample: Any) -> tuple[Any, list[Events]]:
    """Decode the recordings of a sample; return the sample (a list if it was one), and its parts as a list."""
    parts = map_sample(sample, lambda events: events)
    return parts, parts if isinstance(parts, list) else [parts]


def with_boxes(transform: Any, sample: Any, boxes: Boxes) -> tuple[Any, Boxes]:
    """Apply a transform to a sample and its boxes.

    Transforms that move the sample, or apply others, have a method `with_boxes`. All others leave boxes where they are.

    Raises:
        TypeError: A subclass overrides `__call__` but not `with_boxes`, so the two might do different things.
    """
    if not hasattr(type(transform), "with_boxes"):
        return transform(sample), boxes
    called, moved = (
        next(i for i, kind in enumerate(type(transform).__mro__) if name in vars(kind))
        for name in ("__call__", "with_boxes")
    )
    if called < moved:
        raise TypeError(f"{type(transform).__name__} overrides __call__, so it must override with_boxes, too")
    made: tuple[Any, Boxes] = transform.with_boxes(sample, boxes)
    return made


def move_boxes(sample: Any, boxes: Boxes, change: Change) -> Boxes:
    """Apply a change of a sample's coordinates to its boxes.

    Raises:
        ValueError: The sample has another size than the sensor of the boxes, because an earlier step changed the
            sample but can't move boxes.
    """
    for size in _sizes(sample):
        if size not in (None, boxes.sensor_size):
            seen, known = ("{}x{}".format(*one) for one in (size, boxes.sensor_size))
            raise ValueError(f"boxes can't follow: the sample has {seen} pixels, and the boxes are on {known}")
    moved: Boxes = change(boxes)
    return moved


def _sizes(sample: Any) -> set[tuple[int, int] | None]:
    """Return the `size_of` of a sample, or of each part of a list."""
    return set().union(*map(_sizes, sample)) if isinstance(sample, list | tuple) else {size_of(sample)}


def size_of(sample: Any) -> tuple[int, int] | None:
    """Return the (width, height) of an image, or of a sample's sensor; None if it is unknown."""
    if isinstance(sample, torch.Tensor):
        return sample.shape[-1], sample.shape[-2]
    size: tuple[int, int] | None = getattr(sample, "sensor_size", None)
    return size


def boxes_part_ways(transform: str) -> ValueError:
    """Return the error for a transform that moves the parts of a sample differently, so that no box fits them all."""
    return ValueError(f"boxes can't follow {transform}, which moves parts of a sample differently")
