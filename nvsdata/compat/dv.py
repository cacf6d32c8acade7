"""Event stores of iniVation's dv-processing."""

from __future__ import annotations

from typing import Any

from nvsdata.data.events import Events


def to_event_store(events: Events) -> Any:
    """A `dv_processing.EventStore` of the events. It takes them one by one: about 0.3 µs each.

    ImportError without dv-processing.
    """
    try:
        import dv_processing
    except ImportError:
        raise ImportError("event stores are dv-processing's: pip install dv-processing") from None
    store = dv_processing.EventStore()
    columns = (events.t.tolist(), events.x.tolist(), events.y.tolist(), events.p.astype(bool).tolist())
    for event in zip(*columns, strict=True):
        store.push_back(*event)
    return store


def from_event_store(store: Any, sensor_size: tuple[int, int] | None = None) -> Events:
    """Events from a `dv_processing.EventStore`. ValueError for events outside `sensor_size`."""
    array = store.numpy()
    return Events(array["timestamp"], array["x"], array["y"], array["polarity"], sensor_size)
