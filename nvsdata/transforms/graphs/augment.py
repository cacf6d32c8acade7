"""Augmentation of graphs (thesis 4.4.2) and of events.

In a graph, node positions move, edges stay and pseudo-coordinates follow; nodes may leave the sensor, and pooling
then assigns them to the cells at its border. Events move to whole pixels, and those that leave the sensor are dropped.
All graphs of a sequence, all events of a list, and the boxes of `WithBoxes`, get the same change.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
import torch

from nvsdata.common.validation import factors, not_negative, probability
from nvsdata.data.boxes import Boxes
from nvsdata.data.events import Columns, Events
from nvsdata.data.graph import Graph
from nvsdata.data.recording import Recording, as_events
from nvsdata.transforms.apply import change_all, move_all
from nvsdata.transforms.rng import uniform

Sample = TypeVar("Sample", Graph, Events, Boxes)


@dataclass(frozen=True)
class RandomScale:
    """Scale positions about the sensor's center by a random factor from [low, high) (thesis 4.4.2).

    - `low`: smallest factor, above 0 (default 0.95)
    - `high`: largest factor, at least `low` (default 1.0)

    Takes a `Graph`, `Events`, a `Recording` or a list of them, gives the same. ValueError for settings out of range,
    and graphs without `sensor_size`.
    """

    low: float = 0.95
    high: float = 1.0

    def __post_init__(self) -> None:
        factors(self.low, self.high)

    def __call__(self, sample: Any) -> Any:
        factor = uniform(self.low, self.high)
        return move_all(sample, lambda part: scale(part, factor), graphs=True)


@dataclass(frozen=True)
class RandomFlip:
    """Mirror a graph, or events, with probability `p`.

    - `axis`: 0 (default) swaps left and right, 1 top and bottom
    - `p`: probability (default 0.5)

    Takes a `Graph`, `Events`, a `Recording` or a list of them, gives the same. ValueError for settings out of range,
    and graphs without `sensor_size`.
    """

    axis: int = 0
    p: float = 0.5

    def __post_init__(self) -> None:
        if self.axis not in (0, 1):
            raise ValueError(f"axis must be 0 or 1, not {self.axis}")
        probability("p", self.p)

    def __call__(self, sample: Any) -> Any:
        if uniform(0, 1) >= self.p:
            return change_all(sample, lambda part: part, graphs=True)
        return move_all(sample, lambda part: flip(part, self.axis), graphs=True)


@dataclass(frozen=True)
class RandomRotate:
    """Rotate a graph about the sensor's center by a random angle from [-degrees, degrees).

    - `degrees`: largest angle (default 10.0)

    Takes a `Graph`, `Events`, a `Recording` or a list of them, gives the same. ValueError for a negative angle, and
    graphs without `sensor_size`.
    """

    degrees: float = 10.0

    def __post_init__(self) -> None:
        not_negative("degrees", self.degrees)

    def __call__(self, sample: Any) -> Any:
        degrees = uniform(-self.degrees, self.degrees)
        return move_all(sample, lambda part: rotate(part, degrees), graphs=True)


@dataclass(frozen=True)
class RandomTranslate:
    """Shift a graph by a random distance of up to `pixels` along each axis, in either direction.

    - `pixels`: largest shift (default 2.0)

    Takes a `Graph`, `Events`, a `Recording` or a list of them, gives the same. ValueError for a negative shift.
    """

    pixels: float = 2.0

    def __post_init__(self) -> None:
        not_negative("pixels", self.pixels)

    def __call__(self, sample: Any) -> Any:
        dx, dy = uniform(-self.pixels, self.pixels), uniform(-self.pixels, self.pixels)
        return move_all(sample, lambda part: shift(part, dx, dy), graphs=True)


@dataclass(frozen=True)
class RandomAffine:
    """Slant, stretch, scale, rotate and shift events by random amounts; see `affine`.

    - `scale`: (low, high) of the factor (default 0.95, 1.0)
    - `degrees`: largest angle, either way (default 10.0)
    - `shift`: largest shift in pixels along each axis, either way (default 0.0)
    - `shear`: largest slant, as a share of the height, either way (default 0.0)
    - `stretch`: largest change of the height, as a share of it, either way (default 0.0)

    Takes `Events`, a `Recording` or a list of them, gives `Events`. ValueError for settings out of range.
    """

    scale: tuple[float, float] = (0.95, 1.0)
    degrees: float = 10.0
    shift: float = 0.0
    shear: float = 0.0
    stretch: float = 0.0

    def __post_init__(self) -> None:
        factors(*self.scale)
        for name in ("degrees", "shift", "shear"):
            not_negative(name, getattr(self, name))
        if not 0 <= self.stretch < 1:
            raise ValueError(f"stretch must be at least 0 and less than 1, not {self.stretch}")

    def __call__(self, sample: Any) -> Any:
        drawn = (
            uniform(*self.scale),
            uniform(-self.degrees, self.degrees),
            uniform(-self.shift, self.shift),
            uniform(-self.shift, self.shift),
            uniform(-self.shear, self.shear),
            uniform(1 - self.stretch, 1 + self.stretch),
        )
        return move_all(sample, lambda part: (_affine_boxes if isinstance(part, Boxes) else affine)(part, *drawn))


def affine(
    sample: Events | Recording,
    factor: float = 1.0,
    degrees: float = 0.0,
    dx: float = 0.0,
    dy: float = 0.0,
    shear: float = 0.0,
    stretch: float = 1.0,
) -> Events:
    """Slant, stretch, scale and rotate events about the sensor's center, in this order, then shift them.

    - `sample`: `Events` or a `Recording`
    - `factor`: of the distances from the center (default 1.0)
    - `degrees`: angle from the x axis towards the y axis (default 0.0)
    - `dx`, `dy`: shift in pixels (default 0.0)
    - `shear`: shift along x per pixel of y (default 0.0)
    - `stretch`: factor of distances along y (default 1.0)

    Coordinates are rounded to the nearest pixel; events that leave the sensor are dropped.
    """
    events = as_events(sample)
    width, height = events.sensor_size
    moved = _mapping(events.sensor_size, factor, degrees, dx, dy, shear, stretch)(events.x, events.y)
    x, y = (np.rint(column) for column in moved)
    inside = (x >= 0) & (x < width) & (y >= 0) & (y < height)
    columns = Columns(events.t[inside], x[inside].astype(np.int16), y[inside].astype(np.int16), events.p[inside])
    return events.of(columns)


def _affine_boxes(boxes: Boxes, *settings: float) -> Boxes:
    """Boxes moved as `affine` moves events."""
    return boxes.moved(torch.stack(_mapping(boxes.sensor_size, *settings)(*boxes.pos.double().T), 1).float())


def _mapping(
    sensor_size: tuple[int, int], factor: float, degrees: float, dx: float, dy: float, shear: float, stretch: float
) -> Callable[[Any, Any], tuple[Any, Any]]:
    """Where `affine` maps coordinates x, y."""
    cx, cy = ((side - 1) / 2 for side in sensor_size)
    c, s = factor * math.cos(math.radians(degrees)), factor * math.sin(math.radians(degrees))

    def mapped(x: Any, y: Any) -> tuple[Any, Any]:
        high = y - cy
        across, down = x - cx + shear * high, stretch * high
        return c * across - s * down + cx + dx, s * across + c * down + cy + dy

    return mapped


def scale(graph: Sample, factor: float) -> Sample:
    """Multiply distances of nodes or events from the sensor's center by `factor`.

    ValueError for a graph without `sensor_size`.
    """
    if isinstance(graph, Events):
        return affine(graph, factor)
    center = _center(graph)
    return graph.moved((graph.pos - center) * factor + center)


def flip(sample: Sample, axis: int) -> Sample:
    """Mirror a graph's nodes, or events, along `axis`: 0 maps x to width - 1 - x, 1 maps y to height - 1 - y.

    ValueError for a graph without `sensor_size`.
    """
    if isinstance(sample, Events):
        t, x, y, p = sample.columns
        width, height = sample.sensor_size
        if axis == 0:
            return sample.of(Columns(t, (width - 1 - x).astype(np.int16), y, p))
        return sample.of(Columns(t, x, (height - 1 - y).astype(np.int16), p))
    pos = sample.pos.clone()
    pos[:, axis] = 2 * _center(sample)[axis] - pos[:, axis]
    return sample.moved(pos)


def rotate(graph: Sample, degrees: float) -> Sample:
    """Rotate by `degrees` about the sensor's center, from the x axis towards the y axis (clockwise as seen).

    ValueError for a graph without `sensor_size`.
    """
    if isinstance(graph, Events):
        return affine(graph, degrees=degrees)
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    center = _center(graph)
    return graph.moved((graph.pos - center) @ torch.tensor([[c, s], [-s, c]]) + center)


def shift(graph: Sample, dx: float, dy: float) -> Sample:
    """Move every node or event by (dx, dy) pixels."""
    if isinstance(graph, Events):
        return affine(graph, dx=dx, dy=dy)
    return graph.moved(graph.pos + torch.tensor([dx, dy]))


def _center(graph: Graph | Boxes) -> torch.Tensor:
    if graph.sensor_size is None:
        raise ValueError("the graph has no sensor_size, so its center isn't known")
    return torch.tensor([(side - 1) / 2 for side in graph.sensor_size])
