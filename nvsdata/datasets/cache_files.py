"""Samples as they are stored on disk: as tensors, numbers, strings, lists and dicts, which are safe to load."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

import numpy as np
import torch

from nvsdata.data.events import Events
from nvsdata.data.graph import Graph

VALUES = (type(None), bool, int, float, complex, str, bytes)


def kept(sample: Any) -> list[Any]:
    """A sample as its kind and its content. TypeError if `restored` couldn't give back the same type."""
    kind = type(sample)
    if kind in VALUES:
        return ["value", sample]
    if kind is Events:
        return ["events", sample.torch(), sample.sensor_size, sample.start, sample.stated_end]
    if kind is Graph:
        return ["graph", {field.name: kept(getattr(sample, field.name)) for field in fields(sample)}]
    if kind is list:
        return ["list", [kept(item) for item in sample]]
    if kind is tuple:
        return ["tuple", [kept(item) for item in sample]]
    if kind is dict:
        return ["dict", [[kept(key), kept(value)] for key, value in sample.items()]]
    if kind is torch.Tensor:
        # cloned, because a view would be stored with the whole tensor behind it
        return ["tensor", sample.detach().clone()]
    if kind is np.ndarray or isinstance(sample, np.generic):
        try:
            tensor = torch.from_numpy(np.array(sample, order="C"))
        except TypeError:
            raise TypeError(f"a cache can't keep arrays of {sample.dtype}") from None
        return ["array" if kind is np.ndarray else "number", tensor]
    raise TypeError(
        "a cache keeps Events, graphs, tensors, arrays, numbers, strings, and tuples, lists and dicts of them, "
        f"not {kind.__module__}.{kind.__qualname__}: the last deterministic transform must return one of these"
    )


def restored(given: list[Any]) -> Any:
    """The sample that `kept` was given."""
    kind, value, *more = given
    if kind == "events":
        # checked: transforms rely on it that coordinates are inside the sensor
        size, start, end = more
        t, x, y, p = (value[name].numpy() for name in ("t", "x", "y", "p"))
        return Events(t, x, y, p, size, start=start, end=end)
    if kind == "graph":
        return Graph(**{name: restored(part) for name, part in value.items()})
    if kind in ("list", "tuple"):
        items = [restored(item) for item in value]
        return items if kind == "list" else tuple(items)
    if kind == "dict":
        return {restored(key): restored(item) for key, item in value}
    if kind in ("array", "number"):
        array = value.numpy()
        return array if kind == "array" else array[()]
    return value
