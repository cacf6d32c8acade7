"""The same change of everything that belongs together."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from nvsdata.data.events import Events
from nvsdata.data.graph import Graph
from nvsdata.data.recording import as_events


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
