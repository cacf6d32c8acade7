"""Event images for convolutional networks: counts of events, scaled, cropped, mirrored, normalized (thesis 4.4.4)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, TypeVar

import numpy as np
import torch
from torch.nn.functional import interpolate

from nvsdata.common.memory import check_memory, zeros
from nvsdata.common.validation import positive, probability, whole
from nvsdata.data.boxes import Boxes
from nvsdata.data.events import Events
from nvsdata.data.recording import Recording, events_inside, wrong_type
from nvsdata.kernels.represent.frames import counted
from nvsdata.transforms.apply import change_all, follow
from nvsdata.transforms.events.crops import crop_events, resize_events
from nvsdata.transforms.graphs.augment import flip
from nvsdata.transforms.rng import randint, uniform

Image = TypeVar("Image", torch.Tensor, Events, Boxes)


@dataclass(frozen=True)
class EventImage:
    """Number of ON and OFF events at each pixel: float32 [2, H, W], ON first (thesis 4.4.4).

    Takes `Events` or a `Recording`. A sequence of S `Events` (from `Volumes`) gives [2, S, H, W], as 3D CNNs take it
    (5.3.1). ValueError for an empty sequence or different sensors.
    """

    deterministic: ClassVar[bool] = True

    def __call__(self, sample: Events | Recording | Sequence[Events]) -> torch.Tensor:
        return event_image(sample)


@dataclass(frozen=True)
class Resize:
    """Scale images [..., H, W] so that the smaller side has `size` pixels; bilinear, keeps the aspect ratio.

    - `size`: pixels of the smaller side (default 256, as in the thesis)

    Takes `Events`, a `Recording` or a list of them, too, and gives `Events` at the pixels of such a sensor. ValueError
    for a sensor that would have more than 32,767 pixels along an axis.
    """

    size: int = 256
    deterministic: ClassVar[bool] = True

    def __post_init__(self) -> None:
        whole("size", self.size, 1)

    def __call__(self, image: Any) -> Any:
        return _each(image, lambda part: resize(part, int(self.size)))


@dataclass(frozen=True)
class RandomCrop:
    """A square at a random place, scaled to `size`: [..., H, W] to [..., size, size].

    - `size`: side of the result in pixels (default 224, as in thesis 4.4.4)
    - `scales`: factors, of which one is drawn; the square cut out has a side of `size` times the factor (default
      (1.0,)); thesis 3.5 uses (0.5, 0.667, 0.833, 1.0)

    Takes `Events`, a `Recording` or a list of them, too, which get the same square; gives `Events`. ValueError for
    settings that aren't positive, and images smaller than the square.
    """

    size: int = 224
    scales: tuple[float, ...] = (1.0,)

    def __post_init__(self) -> None:
        whole("size", self.size, 1)
        if not self.scales:
            raise ValueError("scales must hold at least one number")
        for scale in self.scales:
            positive("scales", scale)

    def __call__(self, image: Any) -> Any:
        side = max(1, round(self.size * self.scales[randint(len(self.scales))]))
        if isinstance(image, list | tuple) and not image:
            return []
        height, width = _holds(image[0] if isinstance(image, list | tuple) else image, side)
        x, y = randint(width - side + 1), randint(height - side + 1)

        def cut(part: Any) -> Any:
            square = crop(part, x, y, side)
            return square if side == self.size else resize(square, int(self.size))

        return _each(image, cut)


@dataclass(frozen=True)
class CenterCrop:
    """The square in the middle: [..., H, W] to [..., size, size].

    - `size`: side in pixels (default 224)

    Takes `Events`, a `Recording` or a list of them, too, and gives `Events`. ValueError for images smaller than the
    square.
    """

    size: int = 224
    deterministic: ClassVar[bool] = True

    def __post_init__(self) -> None:
        whole("size", self.size, 1)

    def __call__(self, image: Any) -> Any:
        return _each(image, lambda part: center_crop(part, int(self.size)))


@dataclass(frozen=True)
class RandomHorizontalFlip:
    """Swap left and right of images [..., H, W] with a probability; `RandomFlip` does so with events.

    - `p`: probability (default 0.5)
    """

    p: float = 0.5

    def __post_init__(self) -> None:
        probability("p", self.p)

    def __call__(self, image: torch.Tensor) -> torch.Tensor:
        as_image(image)
        if uniform(0, 1) >= self.p:
            return image
        follow(image, lambda boxes: flip(boxes, 0))
        return image.flip(-1)


@dataclass(frozen=True)
class Normalize:
    """Subtract the mean of all values and divide by their standard deviation (thesis 3.5.1).

    Takes and gives images of any shape. A constant image becomes 0.
    """

    deterministic: ClassVar[bool] = True

    def __call__(self, image: torch.Tensor) -> torch.Tensor:
        return normalize(image)


def event_image(sample: Events | Recording | Sequence[Events]) -> torch.Tensor:
    """Counts of ON and OFF events; see `EventImage`. ValueError for an empty sequence or different sensors."""
    if isinstance(sample, list | tuple):
        images = [event_image(events) for events in sample]
        if not images or any(image.shape != images[0].shape for image in images):
            raise ValueError(f"can't stack images of {sorted({tuple(image.shape) for image in images})}")
        return torch.stack(images, 1)
    events = events_inside(sample)
    width, height = events.sensor_size
    out = zeros(events.sensor_size, (1, 2, height, width))
    counted(events.x, events.y, events.p, np.array([0, len(events)]), out)
    return torch.from_numpy(out[0])


def resize(image: Image, size: int) -> Image:
    """Scale the smaller side to `size`; see `Resize`."""
    height, width = _shape(image)
    smaller = min(height, width)
    tall, wide = round(height * size / smaller), round(width * size / smaller)
    if isinstance(image, Events | Boxes):
        return resize_events(image, wide, tall)
    as_image(image, floats=image.dtype != torch.uint8)
    check_memory((wide, tall), (*image.shape[:-2], tall, wide))
    scaled = interpolate(image.reshape(1, -1, height, width), (tall, wide), mode="bilinear", antialias=True)
    return scaled.view(*image.shape[:-2], tall, wide)


def crop(image: Image, x: int, y: int, size: int) -> Image:
    """The square of `size` pixels whose upper left pixel is (x, y): [..., H, W] to [..., size, size]."""
    if isinstance(image, Events | Boxes):
        return crop_events(image, x, y, size, size)
    return image[..., y : y + size, x : x + size]


def center_crop(image: Image, size: int) -> Image:
    """The square in the middle; ValueError for images smaller than it. See `CenterCrop`."""
    height, width = _holds(image, size)
    return crop(image, (width - size) // 2, (height - size) // 2, size)


def normalize(image: torch.Tensor) -> torch.Tensor:
    """Mean 0 and standard deviation 1 over all values; see `Normalize`."""
    as_image(image, 0, floats=True)
    centered = image - image.mean()
    deviation = centered.square().mean().sqrt()
    return centered / deviation if deviation > 0 else centered


def as_image(image: Any, axes: int = 2, *, floats: bool = False) -> torch.Tensor:
    """The image, or frames, as they are; TypeError unless it's a tensor of at least `axes` axes, or of other numbers
    than `floats`.
    """
    if not isinstance(image, torch.Tensor) or image.ndim < axes:
        raise wrong_type("a tensor [..., H, W], such as EventImage or ToFrames gives", image)
    if floats and not image.is_floating_point():
        raise TypeError(f"it takes a tensor of floating-point numbers, not of {image.dtype}: convert it by .float()")
    return image


def _each(image: Any, change: Callable[[Any], Any]) -> Any:
    """`change` of an image, or of events, or of each of a list of them; boxes follow."""
    _check_kind(image)
    follow(image, change)
    return change(image) if isinstance(image, torch.Tensor) else change_all(image, change)


def _check_kind(image: Any) -> None:
    """TypeError for anything but an image, or events, or a list of them."""
    events = all(
        isinstance(part, Events | Recording) for part in (image if isinstance(image, list | tuple) else [image])
    )
    if not events and not (isinstance(image, torch.Tensor) and image.ndim >= 2):
        raise wrong_type("a tensor [..., H, W], Events, a Recording or a list of Events", image)


def _holds(image: Any, side: int) -> tuple[int, int]:
    if not isinstance(image, Boxes):
        _check_kind(image)
    height, width = _shape(image)
    if min(height, width) < side:
        raise ValueError(f"an image of {width}x{height} holds no square of {side}")
    return height, width


def _shape(image: Any) -> tuple[int, int]:
    if isinstance(image, Events | Recording | Boxes):
        return image.sensor_size[1], image.sensor_size[0]
    return image.shape[-2], image.shape[-1]
