"""The same change of everything that belongs together."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Any

import torch

from nvsdata.data.boxes import Boxes
from nvsdata.data.events import Events
from nvsdata.data.graph import Graph
from nvsdata.data.recording import Recording, as_events, wrong_type


class _Following:
    """Boxes that are moved with a sample."""

    def __init__(self, boxes: Boxes) -> None:
        self.boxes = boxes


_FOLLOWING: ContextVar[_Following | None] = ContextVar("_FOLLOWING", default=None)


@contextmanager
def followed(boxes: Boxes) -> Iterator[_Following]:
    """While the block runs, transforms move the `boxes` of what is given together with their samples."""
    following = _Following(boxes)
    token = _FOLLOWING.set(following)
    try:
        yield following
    finally:
        _FOLLOWING.reset(token)


def follow(sample: Any, change: Callable[[Any], Any]) -> None:
    """Apply a change of a sample's place to the boxes that follow it, if there are any.

    ValueError if the sample has another size than the boxes' sensor: then a step that boxes can't follow came before.
    """
    following = _FOLLOWING.get()
    if following is None:
        return
    for size in _sizes(sample):
        if size not in (None, following.boxes.sensor_size):
            seen, known = ("{}x{}".format(*one) for one in (size, following.boxes.sensor_size))
            raise ValueError(f"boxes can't follow: the sample has {seen} pixels, and they lie on {known}")
    following.boxes = change(following.boxes)


def _sizes(sample: Any) -> set[tuple[int, int] | None]:
    """`size_of` a sample, or of each of a list."""
    return set().union(*map(_sizes, sample)) if isinstance(sample, list | tuple) else {size_of(sample)}


def size_of(sample: Any) -> tuple[int, int] | None:
    """(width, height) of an image, or of a sample's sensor, if it's known."""
    if isinstance(sample, torch.Tensor):
        return sample.shape[-1], sample.shape[-2]
    size: tuple[int, int] | None = getattr(sample, "sensor_size", None)
    return size


def move_all(sample: Any, change: Callable[[Any], Any], *, graphs: bool = False) -> Any:
    """`change_all` for a change of place, which boxes follow: it takes `Boxes`, too."""
    follow(sample, change)
    return change_all(sample, change, graphs=graphs)


def each(change: Callable[[Any], Any], parts: Iterable[Any]) -> list[Any]:
    """`change` applied to each part. ValueError if boxes follow the sample, and the parts move apart."""
    following = _FOLLOWING.get()
    if following is None:
        return [change(part) for part in parts]
    before, made, moved = following.boxes, [], []
    for part in parts:
        following.boxes = before
        made.append(change(part))
        moved.append(following.boxes)
    if any(not boxes.equal(moved[0]) for boxes in moved):
        raise no_boxes(f"{change!r} applied to each part of a sample")
    return made


def stay(what: str) -> None:
    """ValueError if boxes follow the sample: `what` moves it in a way that they can't follow."""
    if _FOLLOWING.get() is not None:
        raise no_boxes(what)


def no_boxes(what: str) -> ValueError:
    """The error to raise where boxes can't follow."""
    return ValueError(f"boxes can't follow {what}, which moves parts of a sample apart")


def change_all(sample: Any, change: Callable[[Any], Any], *, graphs: bool = False) -> Any:
    """`change` applied to `Events`, a `Recording` or, with `graphs`, a `Graph`, or to each of a list of them, such as
    `Volumes` gives.

    A recording is decoded. TypeError for anything else.
    """
    if isinstance(sample, list | tuple):
        return [change_all(part, change, graphs=graphs) for part in sample]
    if graphs and isinstance(sample, Graph):
        return change(sample)
    if not isinstance(sample, Events | Recording):
        raise wrong_type(f"{'a Graph, ' if graphs else ''}Events, a Recording or a list of them", sample)
    return change(as_events(sample))


def decoded(sample: Any) -> tuple[Any, list[Events]]:
    """`Events` in place of recordings, in the sample's own form, and a list of them."""
    parts = change_all(sample, lambda events: events)
    return parts, parts if isinstance(parts, list) else [parts]
