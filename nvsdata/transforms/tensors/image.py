"""Images of event counts for convolutional networks: scaled, cropped, normalized (thesis, section 4.4.4)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, TypeVar

import numpy as np
import torch
from torch.nn.functional import interpolate

from nvsdata.common.memory import check_memory, zeros
from nvsdata.common.validation import positive, whole
from nvsdata.data.boxes import Boxes
from nvsdata.data.events import Events
from nvsdata.data.recording import Recording, events_inside, wrong_type
from nvsdata.kernels.represent.frames import counted
from nvsdata.transforms.apply import Change, SpatialTransform, check_sample, size_of
from nvsdata.transforms.events.crops import crop_events, resize_events
from nvsdata.transforms.rng import randint

Image = TypeVar("Image", torch.Tensor, Events, Boxes)

SCALES = (0.5, 0.667, 0.833, 1.0)  # factors of multi-scale crops (thesis, section 3.5.1)


@dataclass(frozen=True)
class EventImage:
    """Count the ON and OFF events of each pixel (thesis, section 4.4.4).

    Returns:
        float32 [2, H, W], ON first. The call takes `Events` or a `Recording`. For a sequence of S `Events`, such as
        `RandomWindows` returns, the result is [2, S, H, W], the input of 3D CNNs (thesis, section 5.3.1).

    Raises:
        ValueError: The sequence is empty, or its sensors differ.

    Example:
        >>> from nvsdata import Events, transforms as T
        >>> T.EventImage()(Events([0, 10, 30], [1, 1, 0], [0, 0, 0], [1, 1, 0], (2, 1))).tolist()
        [[[0.0, 2.0]], [[1.0, 0.0]]]
    """

    deterministic: ClassVar[bool] = True

    def __call__(self, sample: Events | Recording | Sequence[Events]) -> torch.Tensor:
        if isinstance(sample, list | tuple):
            images = [self(events) for events in sample]
            if not images or any(image.shape != images[0].shape for image in images):
                raise ValueError(f"can't stack images of {sorted({tuple(image.shape) for image in images})}")
            return torch.stack(images, 1)
        events = events_inside(sample)
        width, height = events.sensor_size
        out = zeros(events.sensor_size, (1, 2, height, width))
        counted(events.x, events.y, events.p, np.array([0, len(events)]), out)
        return torch.from_numpy(out[0])


@dataclass(frozen=True)
class Resize(SpatialTransform):
    """Scale images, which are interpolated bilinearly, or sensors.

    Args:
        size: Length of the smaller side in pixels (default 256, as in the thesis), which keeps the aspect ratio; or
            (height, width) in pixels, as in torchvision.

    Returns:
        Images or `Events`. The call takes images [..., H, W]; or `Events`, a `Recording` or a list of these.

    Raises:
        ValueError: `size` isn't a positive integer or two, or a sensor would have more than 32,767 pixels along an
            axis.

    Example:
        >>> import nvsdata
        >>> from nvsdata import transforms as T
        >>> T.Resize(90)(nvsdata.example()).sensor_size
        (120, 90)
        >>> T.Resize((64, 80))(nvsdata.example()).sensor_size
        (80, 64)
    """

    size: int | tuple[int, int] = 256
    deterministic: ClassVar[bool] = True
    images: ClassVar[bool] = True

    def __post_init__(self) -> None:
        sides = self.size if isinstance(self.size, list | tuple) else (self.size,)
        if not 1 <= len(sides) <= 2:
            raise ValueError(f"size must be one number, or a height and a width, not {self.size}")
        for side in sides:
            whole("size", side, 1)
        # a hashable value with one repr; a sequence of one number means the smaller side, as in torchvision
        object.__setattr__(self, "size", int(sides[0]) if len(sides) == 1 else (int(sides[0]), int(sides[1])))

    def _change(self, sample: Any) -> Change:
        return lambda part: _resized(part, self.size)


@dataclass(frozen=True)
class RandomCrop(SpatialTransform):
    """Cut a square at a random position, and scale it to `size`.

    Args:
        size: Side of the result in pixels (default 224, as in the thesis, section 4.4.4).
        scales: Factors, one of which is sampled: the square that is cut has a side of `size` times the factor (default
            (1.0,)). The thesis, section 3.5, uses (0.5, 0.667, 0.833, 1.0).

    Returns:
        Images [..., size, size] or `Events`. The call takes images [..., H, W]; or `Events`, a `Recording` or a list of
        these, from which the same square is cut.

    Raises:
        ValueError: A setting isn't positive, or the image is smaller than the square.

    Example:
        >>> import torch
        >>> from nvsdata import transforms as T
        >>> T.RandomCrop(24, scales=(0.5, 1.0))(torch.rand(3, 40, 60)).shape
        torch.Size([3, 24, 24])
    """

    size: int = 224
    scales: tuple[float, ...] = (1.0,)
    images: ClassVar[bool] = True

    def __post_init__(self) -> None:
        whole("size", self.size, 1)
        if not self.scales:
            raise ValueError("scales must have at least one number")
        for scale in self.scales:
            positive("scales", scale)

    def _change(self, sample: Any) -> Change:
        side = max(1, round(self.size * self.scales[randint(len(self.scales))]))
        x = y = 0
        for part in sample[:1] if isinstance(sample, list | tuple) else [sample]:
            check_sample(part, images=part is sample)
            width, height = _with_room(part, side)
            x, y = randint(width - side + 1), randint(height - side + 1)

        def cut(part: Any) -> Any:
            square = _square(part, x, y, side)
            return square if side == self.size else _resized(square, int(self.size))

        return cut


@dataclass(frozen=True)
class CenterCrop(SpatialTransform):
    """Cut the central square.

    Args:
        size: Side in pixels (default 224).

    Returns:
        Images [..., size, size] or `Events`. The call takes images [..., H, W]; or `Events`, a `Recording` or a list of
        these.

    Raises:
        ValueError: `size` isn't a positive integer, or the image is smaller than the square.

    Example:
        >>> import torch
        >>> from nvsdata import transforms as T
        >>> T.CenterCrop(24)(torch.rand(3, 40, 60)).shape
        torch.Size([3, 24, 24])
    """

    size: int = 224
    deterministic: ClassVar[bool] = True
    images: ClassVar[bool] = True

    def __post_init__(self) -> None:
        whole("size", self.size, 1)

    def _change(self, sample: Any) -> Change:
        return lambda part: center_square(part, int(self.size))


@dataclass(frozen=True)
class Normalize:
    """Subtract the mean of all values, and divide by their standard deviation (thesis, section 3.5.1).

    Returns:
        A tensor of the same shape. A constant image becomes 0. The call takes a tensor of any shape.

    Raises:
        TypeError: The call gets anything but a tensor of floating-point numbers.

    Example:
        >>> import torch
        >>> from nvsdata import transforms as T
        >>> T.Normalize()(torch.tensor([[1.0, 3.0]])).tolist()
        [[-1.0, 1.0]]
    """

    deterministic: ClassVar[bool] = True

    def __call__(self, image: torch.Tensor) -> torch.Tensor:
        check_image(image, 0, floats=True)
        centered = image - image.mean()
        deviation = centered.square().mean().sqrt()
        return centered / deviation if deviation > 0 else centered


def check_image(image: Any, axes: int = 2, *, floats: bool = False) -> None:
    """Raise TypeError unless this is a tensor of at least `axes` axes; if `floats`, of floating-point numbers."""
    if not isinstance(image, torch.Tensor) or image.ndim < axes:
        raise wrong_type("sample", "a tensor [..., H, W], such as EventImage or ToFrames returns", image)
    if floats and not image.is_floating_point():
        raise TypeError(
            f"sample must be a tensor of floating-point numbers, not of {image.dtype}: convert it by .float()"
        )


def center_square(image: Image, size: int) -> Image:
    """Return the central square; see `CenterCrop`."""
    width, height = _with_room(image, size)
    return _square(image, (width - size) // 2, (height - size) // 2, size)


def _square(image: Image, x: int, y: int, size: int) -> Image:
    """Return the square of `size` pixels whose upper left pixel is (x, y)."""
    if isinstance(image, Events | Boxes):
        return crop_events(image, x, y, size, size)
    return image[..., y : y + size, x : x + size]


def _resized(image: Image, size: int | tuple[int, int]) -> Image:
    """Scale the smaller side to `size`, or both; see `Resize`."""
    width, height = _size(image)
    smaller = min(height, width)
    tall, wide = (round(side * size / smaller) for side in (height, width)) if isinstance(size, int) else size
    if isinstance(image, Events | Boxes):
        return resize_events(image, wide, tall)
    check_image(image, floats=image.dtype != torch.uint8)
    check_memory((wide, tall), (*image.shape[:-2], tall, wide))
    scaled = interpolate(image.reshape(1, -1, height, width), (tall, wide), mode="bilinear", antialias=True)
    return scaled.view(*image.shape[:-2], tall, wide)


def _with_room(image: Any, side: int) -> tuple[int, int]:
    """Return the (width, height) of an image. ValueError if it is smaller than a square of `side` pixels."""
    width, height = _size(image)
    if min(height, width) < side:
        raise ValueError(f"an image of {width}x{height} contains no square of {side}")
    return width, height


def _size(image: Any) -> tuple[int, int]:
    size = size_of(image)
    assert size is not None
    return size
