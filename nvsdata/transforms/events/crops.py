"""Parts of the sensor, and coarser sensors."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, TypeVar

import numpy as np

from nvsdata.common.validation import whole
from nvsdata.data.boxes import Boxes
from nvsdata.data.events import MAX_COORDINATE, Columns, Events
from nvsdata.kernels.represent.filters import in_rectangle
from nvsdata.transforms.apply import move_all

Moving = TypeVar("Moving", Events, Boxes)


@dataclass(frozen=True)
class Crop:
    """The events of a rectangle of the sensor, which becomes the sensor.

    - `x`, `y`: its upper left pixel
    - `width`, `height`: its size in pixels

    Takes `Events`, a `Recording` or a list of them, gives `Events`. ValueError for settings that aren't whole numbers
    or out of range, and for a rectangle that isn't within the sensor.
    """

    x: int
    y: int
    width: int
    height: int
    deterministic: ClassVar[bool] = True

    def __post_init__(self) -> None:
        for name, least in (("x", 0), ("y", 0), ("width", 1), ("height", 1)):
            whole(name, getattr(self, name), least)

    def __call__(self, sample: Any) -> Any:
        rectangle = int(self.x), int(self.y), int(self.width), int(self.height)
        return move_all(sample, lambda events: crop_events(events, *rectangle))


@dataclass(frozen=True)
class Downsample:
    """Divide coordinates by `factor`, and round times down to multiples of `step`, counted from `Events.start`.

    - `factor`: pixels along each axis that become one (default 2)
    - `step`: µs (default 1)

    No events are lost, and none are merged. Takes `Events`, a `Recording` or a list of them, gives `Events`. ValueError
    for settings that aren't positive whole numbers.
    """

    factor: int = 2
    step: int = 1
    deterministic: ClassVar[bool] = True

    def __post_init__(self) -> None:
        whole("factor", self.factor, 1)
        whole("step", self.step, 1)

    def __call__(self, sample: Any) -> Any:
        return move_all(sample, lambda events: downsample(events, int(self.factor), int(self.step)))


def crop_events(events: Moving, x: int, y: int, width: int, height: int) -> Moving:
    """The events of a rectangle of the sensor; ValueError if it isn't within. See `Crop`."""
    whole_width, whole_height = events.sensor_size
    if not (0 <= x < x + width <= whole_width and 0 <= y < y + height <= whole_height):
        sensor = f"a sensor of {whole_width}x{whole_height}"
        raise ValueError(f"{sensor} has no {width}x{height} pixels from ({x}, {y}) on")
    if isinstance(events, Boxes):
        return events.seen(x, y, (1, 1), (width, height))
    t, xs, ys, p = events.columns.take(in_rectangle(events.x, events.y, x, y, width, height))
    return events.resized(Columns(t, xs - np.int16(x), ys - np.int16(y), p), (width, height))


def downsample(events: Moving, factor: int = 2, step: int = 1) -> Moving:
    """Coarser coordinates and times; see `Downsample`."""
    size = (-(-events.sensor_size[0] // factor), -(-events.sensor_size[1] // factor))
    if isinstance(events, Boxes):
        return events.seen(0, 0, (1 / factor, 1 / factor), size)
    t, x, y, p = events.columns
    if step > 1:
        t = events.start + (t - events.start) // step * step
    if factor > 1:
        divisor = np.int16(min(factor, 2**15 - 1))
        x, y = x // divisor, y // divisor
    return events.resized(Columns(t, x, y, p), size)


def resize_events(events: Moving, width: int, height: int) -> Moving:
    """The events at the pixels of a sensor of another size that lie where theirs do, rounded down.

    ValueError for a size that no sensor has: more than 32,767 pixels along an axis.
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
