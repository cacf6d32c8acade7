"""Conversion of events and transforms from and to tonic, which isn't imported: its events are structured arrays."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from nvsdata.compat.arrays import filled
from nvsdata.data.events import Events
from nvsdata.data.recording import as_events

TONIC = np.dtype([("x", np.int16), ("y", np.int16), ("t", np.int64), ("p", np.bool_)])
"""Type of the events in tonic's datasets."""


def to_tonic(events: Events) -> np.ndarray:
    """Convert events to a structured array as in tonic's datasets.

    Args:
        events: The events.

    Returns:
        [N], with fields x and y (int16, pixels), t (int64, µs) and p (bool).

    Example:
        >>> to_tonic(Events([5], [1], [2], [1]))[0].tolist()
        (1, 2, 5, True)
    """
    return filled(events, TONIC)


def from_tonic(array: np.ndarray, sensor_size: tuple[int, ...] | None = None) -> Events:
    """Convert an array of tonic to events.

    Args:
        array: Structured array [N] with fields x, y, t (µs) and p, in any order.
        sensor_size: (width, height), or (width, height, polarities) as in tonic (default: the smallest sensor that
            contains the events).

    Raises:
        ValueError: If a field is missing, or if `Events` doesn't take the values.

    Example:
        >>> from_tonic(np.array([(1, 2, 5, True)], TONIC), sensor_size=(34, 34, 2))
        Events(1 events, 0 µs, 34x34)
    """
    size = None if sensor_size is None else (int(sensor_size[0]), int(sensor_size[1]))
    return Events.from_structured(array, size)


@dataclass(frozen=True)
class FromTonic:
    """A transform of tonic as a transform of nvsdata.

    The transform gets an array of tonic's events. If it returns such an array, the array becomes `Events` again;
    anything else, such as frames, is returned unchanged. Transforms that use random numbers take them from numpy's
    global generator, which the `seed` of a dataset doesn't set.

    Args:
        transform: Transform of tonic, such as `tonic.transforms.Denoise(10_000)`.

    Example:
        >>> first_event = FromTonic(lambda array: array[:1])
        >>> first_event(Events([5, 6], [1, 0], [2, 2], [1, 0]))
        Events(1 events, 0 µs, 2x3)
    """

    transform: Callable[[np.ndarray], Any]

    def __call__(self, events: Any) -> Any:
        """Apply the transform to events, or to a recording, which is decoded."""
        given = as_events(events, "events")
        result = self.transform(to_tonic(given))
        is_events = isinstance(result, np.ndarray) and {"t", "x", "y", "p"} <= set(result.dtype.names or ())
        return from_tonic(result, given.sensor_size) if is_events else result


@dataclass(frozen=True)
class ForTonic:
    """A transform of nvsdata as a transform of tonic.

    The transform gets `Events`. If it returns `Events`, these become an array of tonic's events again; anything else is
    returned unchanged.

    Args:
        transform: Transform of nvsdata, such as `T.ToFrames(10)`.
        sensor_size: (width, height, polarities) as in tonic's datasets, or (width, height).

    Example:
        >>> from nvsdata import transforms as T
        >>> array = to_tonic(Events([5, 6], [1, 0], [2, 2], [1, 0]))
        >>> ForTonic(T.RelativeTime(), (34, 34, 2))(array)["t"].tolist()
        [0, 1]
    """

    transform: Callable[[Events], Any]
    sensor_size: tuple[int, ...]

    def __call__(self, array: np.ndarray) -> Any:
        """Apply the transform to an array of tonic's events."""
        result = self.transform(from_tonic(array, self.sensor_size))
        return to_tonic(result) if isinstance(result, Events) else result
