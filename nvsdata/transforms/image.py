"""Event images for convolutional networks: counts of events, scaled, cropped, mirrored, normalized (thesis 4.4.4)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import torch
from torch.nn.functional import interpolate

from nvsdata.common.validation import positive, probability
from nvsdata.data.events import Events
from nvsdata.data.recording import Recording, as_events
from nvsdata.transforms.draws import randint, uniform


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
    """

    size: int = 256
    deterministic: ClassVar[bool] = True

    def __post_init__(self) -> None:
        positive("size", self.size)

    def __call__(self, image: torch.Tensor) -> torch.Tensor:
        return resize(image, self.size)


@dataclass(frozen=True)
class RandomCrop:
    """A square at a random place, scaled to `size`: [..., H, W] to [..., size, size].

    - `size`: side of the result in pixels (default 224, as in thesis 4.4.4)
    - `scales`: factors, of which one is drawn; the square cut out has a side of `size` times the factor (default
      (1.0,)); thesis 3.5 uses (0.5, 0.667, 0.833, 1.0)

    ValueError for settings that aren't positive, and images smaller than the square.
    """

    size: int = 224
    scales: tuple[float, ...] = (1.0,)

    def __post_init__(self) -> None:
        positive("size", self.size)
        if not self.scales:
            raise ValueError("scales must hold at least one number")
        for scale in self.scales:
            positive("scales", scale)

    def __call__(self, image: torch.Tensor) -> torch.Tensor:
        side = max(1, round(self.size * self.scales[randint(len(self.scales))]))
        height, width = _holds(image, side)
        cut = crop(image, randint(width - side + 1), randint(height - side + 1), side)
        return cut if side == self.size else resize(cut, self.size)


@dataclass(frozen=True)
class CenterCrop:
    """The square in the middle: [..., H, W] to [..., size, size].

    - `size`: side in pixels (default 224)

    ValueError for images smaller than the square.
    """

    size: int = 224
    deterministic: ClassVar[bool] = True

    def __post_init__(self) -> None:
        positive("size", self.size)

    def __call__(self, image: torch.Tensor) -> torch.Tensor:
        return center_crop(image, self.size)


@dataclass(frozen=True)
class RandomHorizontalFlip:
    """Swap left and right of images [..., H, W] with a probability.

    - `p`: probability (default 0.5)
    """

    p: float = 0.5

    def __post_init__(self) -> None:
        probability("p", self.p)

    def __call__(self, image: torch.Tensor) -> torch.Tensor:
        return image.flip(-1) if uniform(0, 1) < self.p else image


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
    events = as_events(sample)
    width, height = events.sensor_size
    pixel, off = torch.from_numpy(events.y).long() * width + torch.from_numpy(events.x), torch.from_numpy(events.p) == 0
    counts = torch.bincount(pixel + off * (width * height), minlength=2 * width * height)
    return counts.view(2, height, width).float()


def resize(image: torch.Tensor, size: int) -> torch.Tensor:
    """Scale the smaller side to `size`; see `Resize`."""
    height, width = image.shape[-2:]
    smaller = min(height, width)
    shape = round(height * size / smaller), round(width * size / smaller)
    scaled = interpolate(image.reshape(1, -1, height, width), shape, mode="bilinear", antialias=True)
    return scaled.view(*image.shape[:-2], *shape)


def crop(image: torch.Tensor, x: int, y: int, size: int) -> torch.Tensor:
    """The square of `size` pixels whose upper left pixel is (x, y): [..., H, W] to [..., size, size]."""
    return image[..., y : y + size, x : x + size]


def center_crop(image: torch.Tensor, size: int) -> torch.Tensor:
    """The square in the middle; ValueError for images smaller than it. See `CenterCrop`."""
    height, width = _holds(image, size)
    return crop(image, (width - size) // 2, (height - size) // 2, size)


def normalize(image: torch.Tensor) -> torch.Tensor:
    """Mean 0 and standard deviation 1 over all values; see `Normalize`."""
    centered = image - image.mean()
    deviation = centered.square().mean().sqrt()
    return centered / deviation if deviation > 0 else centered


def _holds(image: torch.Tensor, side: int) -> tuple[int, int]:
    height, width = image.shape[-2:]
    if min(height, width) < side:
        raise ValueError(f"an image of {width}x{height} holds no square of {side}")
    return height, width
