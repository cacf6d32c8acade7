"""Conversion of events from and to the arrays of Metavision, spikingjelly and dv-processing."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from nvsdata.data.events import Events

EVENT_CD = np.dtype([("x", "<u2"), ("y", "<u2"), ("p", "<i2"), ("t", "<i8")])
"""Type of Metavision's events, EventCD."""


def to_metavision(events: Events) -> np.ndarray:
    """Convert events to a structured array of Metavision's EventCD.

    Args:
        events: The events.

    Returns:
        [N], with fields x and y (uint16, pixels), p (int16, 0 or 1) and t (int64, µs).

    Example:
        >>> to_metavision(Events([5], [1], [2], [1]))[0].tolist()
        (1, 2, 1, 5)
    """
    return filled(events, EVENT_CD)


def from_metavision(array: np.ndarray, sensor_size: tuple[int, int] | None = None) -> Events:
    """Convert an array of Metavision's EventCD to events.

    Args:
        array: Structured array [N] with fields x, y, p and t (µs).
        sensor_size: (width, height) in pixels (default: the smallest that contains the events).

    Raises:
        ValueError: If a field is missing, or if `Events` doesn't take the values.

    Example:
        >>> from_metavision(np.array([(1, 2, 1, 5)], EVENT_CD))
        Events(1 events, 0 µs, 2x3)
    """
    return Events.from_structured(array, sensor_size)


def to_dict(events: Events) -> dict[str, np.ndarray]:
    """Convert events to a dict of arrays, as spikingjelly's datasets return for `data_type="event"`.

    Args:
        events: The events.

    Returns:
        Arrays t (int64, µs), x, y (int16, pixels) and p (uint8), each [N].

    Example:
        >>> sorted(to_dict(Events([5], [1], [2], [1])))
        ['p', 't', 'x', 'y']
    """
    return events.columns._asdict()


def from_dict(columns: Mapping[str, Any], sensor_size: tuple[int, int] | None = None) -> Events:
    """Convert a mapping of arrays to events.

    Args:
        columns: Mapping with t (µs), x, y and p, such as a dict, or the result of `numpy.load` for an .npz file.
        sensor_size: (width, height) in pixels (default: the smallest that contains the events).

    Raises:
        ValueError: If a key is missing, or if `Events` doesn't take the values.

    Example:
        >>> from_dict({"t": [5], "x": [1], "y": [2], "p": [1]})
        Events(1 events, 0 µs, 2x3)
    """
    missing = sorted({"t", "x", "y", "p"} - set(columns))
    if missing:
        raise ValueError(f"the events have no {', '.join(missing)}; their keys are {', '.join(map(str, columns))}")
    t, x, y, p = (np.asarray(columns[name]) for name in ("t", "x", "y", "p"))
    return Events(t, x, y, p, sensor_size)


def to_event_store(events: Events) -> Any:
    """Convert events to a `dv_processing.EventStore`, which takes about 0.3 µs per event.

    Args:
        events: The events.

    Returns:
        The event store.

    Raises:
        ImportError: If dv-processing isn't installed.
    """
    try:
        import dv_processing
    except ImportError:
        raise ImportError("event stores need the package dv-processing: pip install dv-processing") from None
    store = dv_processing.EventStore()
    columns = (events.t.tolist(), events.x.tolist(), events.y.tolist(), events.p.astype(bool).tolist())
    for event in zip(*columns, strict=True):
        store.push_back(*event)
    return store


def from_event_store(store: Any, sensor_size: tuple[int, int] | None = None) -> Events:
    """Convert a `dv_processing.EventStore` to events.

    Args:
        store: The event store.
        sensor_size: (width, height) in pixels (default: the smallest that contains the events).

    Raises:
        ValueError: If events are outside `sensor_size`.
    """
    array = store.numpy()
    return Events(array["timestamp"], array["x"], array["y"], array["polarity"], sensor_size)


def filled(events: Events, kind: np.dtype[Any]) -> np.ndarray:
    """Return the events as a structured array [N] of the dtype `kind`, which has fields t, x, y and p."""
    out = np.empty(len(events), kind)
    for name in ("t", "x", "y", "p"):
        out[name] = getattr(events, name)
    return out
