"""tonic's events and transforms. tonic itself isn't needed: its events are structured arrays."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from nvsdata.compat.arrays import _filled
from nvsdata.data.events import Events
from nvsdata.data.recording import as_events

TONIC = np.dtype([("x", np.int16), ("y", np.int16), ("t", np.int64), ("p", np.bool_)])
"""The events of tonic's datasets."""


def to_tonic(events: Events) -> np.ndarray:
    """Structured array [N] as tonic's datasets have: x, y int16, t int64 (µs), p bool."""
    return _filled(events, TONIC)


def from_tonic(array: np.ndarray, sensor_size: tuple[int, ...] | None = None) -> Events:
    """Events from tonic's array; of `sensor_size`, which may be tonic's (width, height, polarities).

    ValueError for a missing field, and for values that `Events` doesn't take.
    """
    size = None if sensor_size is None else (int(sensor_size[0]), int(sensor_size[1]))
    return Events.from_structured(array, size)


@dataclass(frozen=True)
class FromTonic:
    """One of tonic's transforms in a pipeline of ours: it gets tonic's array, and what it gives becomes `Events` again.

    - `transform`: tonic's, such as `tonic.transforms.Denoise(10_000)`

    What isn't an array of events, such as tonic's frames, stays as it is. A transform with random draws takes them from
    numpy's generator, which a dataset's `seed` doesn't set.
    """

    transform: Callable[[np.ndarray], Any]

    def __call__(self, events: Any) -> Any:
        """The transform of events, or of a recording, which is decoded."""
        given = as_events(events)
        made = self.transform(to_tonic(given))
        named = isinstance(made, np.ndarray) and {"t", "x", "y", "p"} <= set(made.dtype.names or ())
        return from_tonic(made, given.sensor_size) if named else made


@dataclass(frozen=True)
class ForTonic:
    """One of our transforms in a pipeline of tonic's: it gets `Events`; Events that it gives become an array again.

    - `transform`: ours, such as `T.ToFrames(10)`
    - `sensor_size`: as tonic's datasets have it, (width, height, polarities) or (width, height)
    """

    transform: Callable[[Events], Any]
    sensor_size: tuple[int, ...]

    def __call__(self, array: np.ndarray) -> Any:
        """The transform of tonic's array of events."""
        made = self.transform(from_tonic(array, self.sensor_size))
        return to_tonic(made) if isinstance(made, Events) else made
