"""Crops of the sensor, and scaling to other resolutions."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, TypeVar

import numpy as np

from nvsdata.common.validation import whole
from nvsdata.data.boxes import Boxes
from nvsdata.data.events import MAX_COORDINATE, Columns, Events
from nvsdata.kernels.represent.filters import in_rectangle
from nvsdata.transforms.apply import Change, SpatialTransform

Moving = TypeVar("Moving", Events, Boxes)


@dataclass(frozen=True)
class Crop(SpatialTransform):
    """Keep the events in a rectangle of the sensor. The rectangle becomes the new sensor.

    Args:
        x: Left column of the rectangle, in pixels.
        y: Top row of the rectangle, in pixels.
        width: Width of the rectangle in pixels.
        height: Height of the rectangle in pixels.

    Returns:
        `Events`. The call takes `Events`, a `Recording` or a list of them.

    Raises:
        ValueError: A setting is out of range, or the rectangle isn't within the sensor.

    Example:
        >>> import nvsdata
        >>> from nvsdata import transforms as T
        >>> T.Crop(10, 20, 100, 50)(nvsdata.example()).sensor_size
        (100, 50)
    """

    x: int
    y: int
    width: int
    height: int
    deterministic: ClassVar[bool] = True

    def __post_init__(self) -> None:
        for name, least in (("x", 0), ("y", 0), ("width", 1), ("height", 1)):
            whole(name, getattr(self, name), least)

    def _change(self, sample: Any) -> Change:
        rectangle = int(self.x), int(self.y), int(self.width), int(self.height)
        return lambda part: crop_events(part, *rectangle)


@dataclass(frozen=True)
class Downsample(SpatialTransform):
    """Divide coordinates by `factor`, and round times down to multiples of `step`, counted from `Events.start`.

    No events are dropped or merged.

    Args:
        factor: Number of pixels along each axis that become one pixel (default 2).
        step: Step of the new times in µs (default 1).

    Returns:
        `Events`. The call takes `Events`, a `Recording` or a list of them.

    Raises:
        ValueError: A setting isn't a positive integer.

    Example:
        >>> import nvsdata
        >>> from nvsdata import transforms as T
        >>> T.Downsample(4)(nvsdata.example()).sensor_size
        (60, 45)
    """

    factor: int = 2
    step: int = 1
    deterministic: ClassVar[bool] = True

    def __post_init__(self) -> None:
        whole("factor", self.factor, 1)
        whole("step", self.step, 1)

    def _change(self, sample: Any) -> Change:
        factor, step = int(self.factor), int(self.step)
        return lambda part: downsample(part, factor, step)


def crop_events(events: Moving, x: int, y: int, width: int, height: int) -> Moving:
    """Return the events, or boxes, of a rectangle. ValueError if it isn't within the sensor. See `Crop`."""
    whole_width, whole_height = events.sensor_size
    if not (0 <= x < x + width <= whole_width and 0 <= y < y + height <= whole_height):
        sensor = f"a sensor of {whole_width}x{whole_height}"
        raise ValueError(f"{sensor} has no {width}x{height} pixels from ({x}, {y}) on")
    if isinstance(events, Boxes):
        return events.seen(x, y, (1, 1), (width, height))
    t, xs, ys, p = events.columns.take(in_rectangle(events.x, events.y, x, y, width, height))
    return events.resized(Columns(t, xs - np.int16(x), ys - np.int16(y), p), (width, height))


def downsample(events: Moving, factor: int, step: int = 1) -> Moving:
    """Return events, or boxes, at a lower resolution; see `Downsample`."""
    size = downsampled_size(events.sensor_size, factor)
    if isinstance(events, Boxes):
        return events.seen(0, 0, (1 / factor, 1 / factor), size)
    t, x, y, p = events.columns
    if step > 1:
        t = events.start + (t - events.start) // step * step
    if factor > 1:
        divisor = np.int16(min(factor, 2**15 - 1))
        x, y = x // divisor, y // divisor
    return events.resized(Columns(t, x, y, p), size)


def downsampled_size(sensor_size: tuple[int, int], factor: int) -> tuple[int, int]:
    """Return the size of a sensor at a lower resolution, rounded up."""
    width, height = sensor_size
    return -(-width // factor), -(-height // factor)


def resize_events(events: Moving, width: int, height: int) -> Moving:
    """Scale events, or boxes, to a sensor of another size; `Resize((height, width))` is the transform.

    Args:
        events: The events or boxes.
        width: Width of the new sensor in pixels.
        height: Height of the new sensor in pixels.

    Returns:
        The events or boxes on the new sensor. Coordinates of events are rounded down; no event is dropped or merged.

    Raises:
        ValueError: The new sensor has more than 32,767 pixels along an axis.

    Example:
        >>> import nvsdata
        >>> from nvsdata import transforms as T
        >>> T.resize_events(nvsdata.example(), 64, 64).sensor_size
        (64, 64)
    """
    if max(width, height) > MAX_COORDINATE + 1:
        sensor = "{}x{}".format(*events.sensor_size)
        limit = f"at most {MAX_COORDINATE + 1} pixels along an axis"
        raise ValueError(
            f"a sensor of {sensor} can't become {width}x{height} pixels: events have {limit}; resize to less"
        )
    if isinstance(events, Boxes):
        scale = width / events.sensor_size[0], height / events.sensor_size[1]
        return events.seen(0, 0, scale, (width, height))
    t, x, y, p = events.columns
    x, y = (
        (column.astype(np.int32) * new // old).astype(np.int16)
        for column, new, old in zip((x, y), (width, height), events.sensor_size, strict=True)
    )
    return events.resized(Columns(t, x, y, p), (width, height))
