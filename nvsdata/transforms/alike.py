"""The same change of all events that belong together."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from nvsdata.data.events import Events
from nvsdata.data.recording import as_events


def alike(sample: Any, change: Callable[[Events], Events]) -> Any:
    """`change` applied to `Events` or a `Recording`, or to each of a list, such as `Volumes` gives.

    TypeError for anything else.
    """
    if isinstance(sample, Sequence) and not isinstance(sample, Events | str):
        return [change(as_events(part)) for part in sample]
    return change(as_events(sample))
