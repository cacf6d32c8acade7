"""The same change of everything that belongs together."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Any

from nvsdata.data.boxes import Boxes
from nvsdata.data.events import Events
from nvsdata.data.graph import Graph
from nvsdata.data.recording import as_events


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


def follow(change: Callable[[Any], Any]) -> None:
    """Apply a change of place to the boxes that follow the sample, if there are any."""
    following = _FOLLOWING.get()
    if following is not None:
        following.boxes = change(following.boxes)


def move_all(sample: Any, change: Callable[[Any], Any]) -> Any:
    """`change_all` for a change of place, which boxes follow: it takes `Boxes`, too."""
    follow(change)
    return change_all(sample, change)


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
    if any(boxes.edges.tolist() != moved[0].edges.tolist() for boxes in moved):
        raise no_boxes(f"{change!r} applied to each part of a sample")
    return made


def stay(what: str) -> None:
    """ValueError if boxes follow the sample: `what` moves it in a way that they can't follow."""
    if _FOLLOWING.get() is not None:
        raise no_boxes(what)


def no_boxes(what: str) -> ValueError:
    """The error to raise where boxes can't follow."""
    return ValueError(f"boxes can't follow {what}, which moves parts of a sample apart")


def change_all(sample: Any, change: Callable[[Any], Any]) -> Any:
    """`change` applied to a graph, `Events` or a `Recording`, or to each of a list, such as `Volumes` gives.

    A recording is decoded. TypeError for anything else.
    """
    if isinstance(sample, list | tuple):
        return [change_all(part, change) for part in sample]
    return change(sample if isinstance(sample, Graph) else as_events(sample))


def decoded(sample: Any) -> tuple[Any, list[Events]]:
    """`Events` in place of recordings, in the sample's own form, and a list of them."""
    parts = change_all(sample, lambda events: events)
    return parts, parts if isinstance(parts, list) else [parts]
