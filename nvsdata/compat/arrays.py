"""Structured arrays of Metavision, and dicts of arrays as spikingjelly has them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from nvsdata.data.events import Events

EVENT_CD = np.dtype([("x", "<u2"), ("y", "<u2"), ("p", "<i2"), ("t", "<i8")])
"""Metavision's EventCD."""


def to_metavision(events: Events) -> np.ndarray:
    """Structured array [N] of Metavision's EventCD: x, y uint16, p int16 (0 or 1), t int64 (µs)."""
    return _filled(events, EVENT_CD)


def from_metavision(array: np.ndarray, sensor_size: tuple[int, int] | None = None) -> Events:
    """Events from an array of EventCD. ValueError for a missing field, and for values that `Events` doesn't take."""
    return Events.from_structured(array, sensor_size)


def to_dict(events: Events) -> dict[str, np.ndarray]:
    """A dict of arrays t, x, y and p, each [N], as spikingjelly's datasets of `data_type="event"` give."""
    return events.columns._asdict()


def from_dict(columns: Mapping[str, Any], sensor_size: tuple[int, int] | None = None) -> Events:
    """Events from a mapping with t (µs), x, y and p, such as a dict or what `numpy.load` gives for an .npz file.

    ValueError for a missing key, and for values that `Events` doesn't take.
    """
    missing = sorted({"t", "x", "y", "p"} - set(columns))
    if missing:
        raise ValueError(f"the events lack {', '.join(missing)}; there are {', '.join(map(str, columns))}")
    t, x, y, p = (np.asarray(columns[name]) for name in ("t", "x", "y", "p"))
    return Events(t, x, y, p, sensor_size)


def _filled(events: Events, kind: np.dtype[Any]) -> np.ndarray:
    out = np.empty(len(events), kind)
    for name in ("t", "x", "y", "p"):
        out[name] = getattr(events, name)
    return out
