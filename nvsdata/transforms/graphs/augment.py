"""Augmentation in the plane of the sensor, of graphs (thesis, section 4.4.2), events, images and boxes.

In a graph, node positions move, edges stay and pseudo-coordinates follow. Nodes may leave the sensor; pooling then
assigns them to the cells at its border. Events move to whole pixels, and those that leave the sensor are dropped. All
graphs of a sequence, all events of a list, and the boxes of `WithBoxes`, get the same change.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar, TypeVar

import numpy as np
import torch

from nvsdata.common.validation import factors, not_negative, probability
from nvsdata.data.boxes import Boxes
from nvsdata.data.events import Columns, Events
from nvsdata.data.graph import Graph
from nvsdata.data.recording import Recording, as_events
from nvsdata.transforms.apply import Change, SpatialTransform
from nvsdata.transforms.rng import uniform

Mirrored = TypeVar("Mirrored", Graph, Events, Boxes)
Mapping = Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]


@dataclass(frozen=True)
class RandomScale(SpatialTransform):
    """Scale positions about the sensor's center by a random factor from [low, high) (thesis, section 4.4.2).

    Args:
        low: Smallest factor, above 0 (default 0.95).
        high: Largest factor, at least `low` (default 1.0). Equal bounds make the factor fixed.

    Returns:
        The moved sample. The call takes a `Graph`, `Events`, a `Recording` (which is decoded), or a list of them.

    Raises:
        ValueError: A setting is out of range, or a graph has no `sensor_size`.

    Example:
        >>> from nvsdata import Events, transforms as T
        >>> T.RandomScale(0.5, 0.5)(Events([0, 10], [0, 8], [4, 4], [1, 1], (9, 9))).x.tolist()
        [2, 6]
    """

    low: float = 0.95
    high: float = 1.0
    graphs: ClassVar[bool] = True

    def __post_init__(self) -> None:
        factors(self.low, self.high)

    def _change(self, sample: Any) -> Change:
        factor = uniform(self.low, self.high)
        return lambda part: affine(part, factor)


@dataclass(frozen=True)
class RandomFlip(SpatialTransform):
    """Mirror a graph, events or images with probability `p`.

    Args:
        axis: 0 (default) swaps left and right, 1 top and bottom.
        p: Probability (default 0.5); 1 always mirrors.

    Returns:
        The mirrored sample. The call takes images [..., H, W]; or a `Graph`, `Events`, a `Recording` (which is decoded)
        or a list of these.

    Raises:
        ValueError: A setting is out of range, or a graph has no `sensor_size`.

    Example:
        >>> from nvsdata import Events, transforms as T
        >>> T.RandomFlip(p=1)(Events([0, 10], [0, 7], [4, 4], [1, 1], (9, 9))).x.tolist()
        [8, 1]
    """

    axis: int = 0
    p: float = 0.5
    graphs: ClassVar[bool] = True
    images: ClassVar[bool] = True

    def __post_init__(self) -> None:
        if self.axis not in (0, 1):
            raise ValueError(f"axis must be 0 or 1, not {self.axis}")
        probability("p", self.p)

    def _change(self, sample: Any) -> Change:
        flipped = uniform(0, 1) < self.p
        return lambda part: _flip(part, self.axis) if flipped else part


@dataclass(frozen=True)
class RandomRotate(SpatialTransform):
    """Rotate about the sensor's center by a random angle from [-degrees, degrees).

    Args:
        degrees: Largest angle in degrees (default 10.0). For a fixed angle, see `affine`.

    Returns:
        The moved sample. The call takes a `Graph`, `Events`, a `Recording` (which is decoded), or a list of them.

    Raises:
        ValueError: The angle is negative, or a graph has no `sensor_size`.

    Example:
        >>> import nvsdata
        >>> from nvsdata import transforms as T
        >>> len(T.RandomRotate(30)(nvsdata.example())) <= len(nvsdata.example())
        True
    """

    degrees: float = 10.0
    graphs: ClassVar[bool] = True

    def __post_init__(self) -> None:
        not_negative("degrees", self.degrees)

    def _change(self, sample: Any) -> Change:
        degrees = uniform(-self.degrees, self.degrees)
        return lambda part: affine(part, degrees=degrees)


@dataclass(frozen=True)
class RandomTranslate(SpatialTransform):
    """Shift by a random distance of up to `pixels` along each axis, in either direction.

    Args:
        pixels: Largest distance in pixels (default 2.0). For a fixed distance, see `affine`.

    Returns:
        The moved sample. The call takes a `Graph`, `Events`, a `Recording` (which is decoded), or a list of them.

    Raises:
        ValueError: The distance is negative.

    Example:
        >>> import nvsdata
        >>> from nvsdata import transforms as T
        >>> len(T.RandomTranslate(5)(nvsdata.example())) <= len(nvsdata.example())
        True
    """

    pixels: float = 2.0
    graphs: ClassVar[bool] = True

    def __post_init__(self) -> None:
        not_negative("pixels", self.pixels)

    def _change(self, sample: Any) -> Change:
        dx, dy = uniform(-self.pixels, self.pixels), uniform(-self.pixels, self.pixels)
        return lambda part: affine(part, dx=dx, dy=dy)


@dataclass(frozen=True)
class Center(SpatialTransform):
    """Shift events by whole pixels, so that the rectangle around them is in the middle of the sensor.

    For crops of different sizes that share a corner, as in N-CARS: mirroring and scaling are then about their centers.

    Returns:
        `Events`. The call takes `Events`, a `Recording` or a list of them, which share one rectangle.

    Example:
        >>> from nvsdata import Events, transforms as T
        >>> T.Center()(Events([0, 10], [0, 2], [0, 1], [1, 1], (9, 9))).x.tolist()
        [3, 5]
    """

    deterministic: ClassVar[bool] = True

    def _change(self, sample: Any) -> Change:
        parts = [part for part in (sample if isinstance(sample, list) else [sample]) if len(part)]
        if not parts:
            return lambda part: part
        width, height = parts[0].sensor_size
        dx = _to_middle(np.concatenate([part.x for part in parts]), width)
        dy = _to_middle(np.concatenate([part.y for part in parts]), height)
        return lambda part: affine(part, dx=dx, dy=dy)


def _to_middle(pixels: np.ndarray, size: int) -> int:
    """Return the shift after which pixels are in the middle of an axis of `size` pixels."""
    return (size - 1 - int(pixels.min()) - int(pixels.max())) // 2


@dataclass(frozen=True)
class RandomAffine(SpatialTransform):
    """Slant, stretch, scale, rotate and shift by random amounts; see `affine`.

    Args:
        scale: Range [low, high) of the scale factor (default (0.95, 1.0)).
        degrees: Largest angle in degrees, in either direction (default 10.0).
        shift: Largest shift in pixels along each axis, in either direction (default 0.0).
        shear: Largest slant in either direction, as a fraction of the height (default 0.0).
        stretch: Largest change of the height in either direction, as a fraction of it (default 0.0).

    Returns:
        The moved sample. The call takes a `Graph`, `Events`, a `Recording` (which is decoded), or a list of them.

    Raises:
        ValueError: A setting is out of range, or a graph has no `sensor_size`.

    Example:
        >>> import nvsdata
        >>> from nvsdata import transforms as T
        >>> T.RandomAffine(degrees=20, shear=0.2)(nvsdata.example()).sensor_size
        (240, 180)
    """

    scale: tuple[float, float] = (0.95, 1.0)
    degrees: float = 10.0
    shift: float = 0.0
    shear: float = 0.0
    stretch: float = 0.0
    graphs: ClassVar[bool] = True

    def __post_init__(self) -> None:
        factors(*self.scale)
        for name in ("degrees", "shift", "shear"):
            not_negative(name, getattr(self, name))
        if not 0 <= self.stretch < 1:
            raise ValueError(f"stretch must be at least 0 and less than 1, not {self.stretch}")

    def _change(self, sample: Any) -> Change:
        drawn = (
            uniform(*self.scale),
            uniform(-self.degrees, self.degrees),
            uniform(-self.shift, self.shift),
            uniform(-self.shift, self.shift),
            uniform(-self.shear, self.shear),
            uniform(1 - self.stretch, 1 + self.stretch),
        )
        return lambda part: affine(part, *drawn)


def affine(
    sample: Mirrored | Recording,
    factor: float = 1.0,
    degrees: float = 0.0,
    dx: float = 0.0,
    dy: float = 0.0,
    shear: float = 0.0,
    stretch: float = 1.0,
) -> Mirrored | Events:
    """Slant, stretch, scale and rotate about the sensor's center, in this order, then shift.

    Args:
        sample: A `Graph`, `Events`, or a `Recording`, which is decoded.
        factor: Factor of the distances from the center (default 1.0).
        degrees: Angle in degrees from the x axis towards the y axis, clockwise in the image (default 0.0).
        dx: Shift to the right in pixels (default 0.0).
        dy: Shift downwards in pixels (default 0.0).
        shear: Shift along x per pixel of y (default 0.0).
        stretch: Factor of distances along y (default 1.0).

    Returns:
        The graph with its nodes moved; or the events with coordinates rounded to the nearest pixel, without those that
        leave the sensor.

    Raises:
        ValueError: A graph has no `sensor_size`, so its center is unknown, and more than a shift is requested.

    Example:
        >>> from nvsdata import Events, transforms as T
        >>> events = Events([0, 10], [0, 7], [4, 4], [1, 1], (9, 9))
        >>> turned = T.affine(events, degrees=90)
        >>> turned.x.tolist(), turned.y.tolist()
        ([4, 4], [0, 7])
    """
    part: Graph | Events | Boxes = as_events(sample) if isinstance(sample, Recording) else sample
    size = part.sensor_size
    if size is None:
        if (factor, degrees, shear, stretch) != (1, 0, 0, 1):
            raise ValueError("the graph has no sensor_size, so its center isn't known")
        size = 1, 1
    mapping = _mapping(size, factor, degrees, dx, dy, shear, stretch)
    if not isinstance(part, Events):
        moved = mapping(*part.pos.numpy().T.astype(np.float64))
        return part.moved(torch.from_numpy(np.stack(moved, 1).astype(np.float32)))  # type: ignore[return-value]
    width, height = size
    x, y = (np.rint(column) for column in mapping(part.x, part.y))
    inside = (x >= 0) & (x < width) & (y >= 0) & (y < height)
    return part.of(Columns(part.t[inside], x[inside].astype(np.int16), y[inside].astype(np.int16), part.p[inside]))


def _mapping(
    sensor_size: tuple[int, int], factor: float, degrees: float, dx: float, dy: float, shear: float, stretch: float
) -> Mapping:
    """Return the function that `affine` applies to coordinates x, y."""
    cx, cy = ((side - 1) / 2 for side in sensor_size)
    c, s = factor * math.cos(math.radians(degrees)), factor * math.sin(math.radians(degrees))

    def mapped(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        high = y - cy
        across, down = x - cx + shear * high, stretch * high
        return c * across - s * down + cx + dx, s * across + c * down + cy + dy

    return mapped


def _flip(part: Any, axis: int) -> Any:
    """Map x to width - 1 - x (axis 0), or y to height - 1 - y (axis 1)."""
    if isinstance(part, torch.Tensor):
        return part.flip(-1 - axis)
    if part.sensor_size is None:
        raise ValueError("the graph has no sensor_size, so its center isn't known")
    last = part.sensor_size[axis] - 1
    if isinstance(part, Events):
        t, x, y, p = part.columns
        if axis == 0:
            return part.of(Columns(t, (last - x).astype(np.int16), y, p))
        return part.of(Columns(t, x, (last - y).astype(np.int16), p))
    pos = part.pos.clone()
    pos[:, axis] = last - pos[:, axis]
    return part.moved(pos)
