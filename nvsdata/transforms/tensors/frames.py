"""Clips, crops and denoising of frames for convolutional networks (thesis, section 3.5)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import torch
from torch.nn import functional as F

from nvsdata.common.validation import whole
from nvsdata.data.boxes import Boxes
from nvsdata.transforms.apply import boxes_part_ways
from nvsdata.transforms.rng import window_start
from nvsdata.transforms.tensors.image import center_square, check_image


@dataclass(frozen=True)
class RandomTemporalCrop:
    """Cut `length` consecutive frames at a random time.

    Args:
        length: Number of frames (default 160, as in the thesis). Three can replace the channels of a color image.

    Returns:
        The clip [length, ..., H, W]. The call takes frames [T, ..., H, W]. If there are fewer, frames of zeros are
        appended.

    Raises:
        ValueError: `length` isn't a positive integer.

    Example:
        >>> import torch
        >>> from nvsdata import transforms as T
        >>> T.RandomTemporalCrop(16)(torch.rand(100, 40, 60)).shape
        torch.Size([16, 40, 60])
    """

    length: int = 160

    def __post_init__(self) -> None:
        whole("length", self.length, 1)

    def __call__(self, frames: torch.Tensor) -> torch.Tensor:
        check_image(frames, 1)
        length = int(self.length)
        start = window_start(max(frames.shape[0] - length, 0) + 1)
        clip = frames[start : start + length]
        return F.pad(clip, (0, 0) * (clip.ndim - 1) + (0, length - clip.shape[0]))


@dataclass(frozen=True)
class SlidingClips:
    """Cut every clip of `length` consecutive frames.

    Args:
        length: Number of frames of a clip (default 3, as in the thesis).

    Returns:
        The clips [T - length + 1, length, ..., H, W], a view of the frames [T, ..., H, W] that the call takes.

    Raises:
        ValueError: There are fewer than `length` frames.

    Example:
        >>> import torch
        >>> from nvsdata import transforms as T
        >>> T.SlidingClips(3)(torch.rand(100, 40, 60)).shape
        torch.Size([98, 3, 40, 60])
    """

    length: int = 3
    deterministic: ClassVar[bool] = True

    def __post_init__(self) -> None:
        whole("length", self.length, 1)

    def __call__(self, frames: torch.Tensor) -> torch.Tensor:
        check_image(frames, 1)
        length = int(self.length)
        if frames.shape[0] < length:
            raise ValueError(f"{frames.shape[0]} frames make no clip of {length}")
        return frames.unfold(0, length, 1).movedim(-1, 1)


@dataclass(frozen=True)
class MotionCrop:
    """Cut the square with the most activity, the sum of absolute values over all frames.

    Args:
        size: Side in pixels (default 24).

    Returns:
        Frames [..., size, size]. The call takes frames [..., H, W]. Of equal squares, the first one is cut.

    Raises:
        ValueError: `size` isn't a positive integer, or the frames are smaller than the square.

    Example:
        >>> import torch
        >>> from nvsdata import transforms as T
        >>> T.MotionCrop(24)(torch.rand(16, 40, 60)).shape
        torch.Size([16, 24, 24])
    """

    size: int = 24
    deterministic: ClassVar[bool] = True

    def __post_init__(self) -> None:
        whole("size", self.size, 1)

    def __call__(self, frames: torch.Tensor) -> torch.Tensor:
        return _most_active(frames, int(self.size))

    def with_boxes(self, frames: Any, boxes: Boxes) -> tuple[Any, Boxes]:
        """Raise a ValueError, because the crop depends on the frames, and boxes can't be cropped alike."""
        raise boxes_part_ways("MotionCrop")


@dataclass(frozen=True)
class FourCrops:
    """Cut the squares used for testing in the thesis.

    The order is: the most active square (`MotionCrop`), the same mirrored left to right, the central
    square, the same mirrored left to right.

    Args:
        size: Side in pixels (default 24).

    Returns:
        Frames [4, ..., size, size]. The call takes frames [..., H, W].

    Raises:
        ValueError: `size` isn't a positive integer, or the frames are smaller than the square.

    Example:
        >>> import torch
        >>> from nvsdata import transforms as T
        >>> T.FourCrops(24)(torch.rand(16, 40, 60)).shape
        torch.Size([4, 16, 24, 24])
    """

    size: int = 24
    deterministic: ClassVar[bool] = True

    def __post_init__(self) -> None:
        whole("size", self.size, 1)

    def __call__(self, frames: torch.Tensor) -> torch.Tensor:
        active = _most_active(frames, int(self.size))
        center = center_square(frames, int(self.size))
        return torch.stack((active, active.flip(-1), center, center.flip(-1)))

    def with_boxes(self, frames: Any, boxes: Boxes) -> tuple[Any, Boxes]:
        """Raise a ValueError, because the crop depends on the frames, and boxes can't be cropped alike."""
        raise boxes_part_ways("FourCrops")


@dataclass(frozen=True)
class MedianDenoise:
    """Replace each pixel by the median of itself and its neighbors to the right, below and diagonally below.

    The median of four values is the mean of the two middle ones, so an isolated spike is removed. Borders are
    replicated.

    Returns:
        Frames of the same shape. The call takes frames [..., H, W] of floating-point numbers.

    Example:
        >>> import torch
        >>> from nvsdata import transforms as T
        >>> T.MedianDenoise()(torch.tensor([[0.0, 9.0, 0.0], [0.0, 0.0, 0.0]])).sum().item()
        0.0
    """

    deterministic: ClassVar[bool] = True

    def __call__(self, frames: torch.Tensor) -> torch.Tensor:
        check_image(frames, floats=True)
        right = torch.cat((frames[..., 1:], frames[..., -1:]), -1)
        pairs = torch.stack((frames, right))
        four = torch.cat((pairs, torch.cat((pairs[..., 1:, :], pairs[..., -1:, :]), -2)))
        return four.sort(0).values[1:3].mean(0)


def _most_active(frames: torch.Tensor, size: int) -> torch.Tensor:
    check_image(frames)
    if min(frames.shape[-2:]) < size:
        raise ValueError(f"frames of {frames.shape[-1]}x{frames.shape[-2]} contain no square of {size}")
    activity = frames.abs().reshape(-1, *frames.shape[-2:]).sum(0, dtype=torch.float64)
    # sums of all squares by an integral image
    total = F.pad(activity.cumsum(0).cumsum(1), (1, 0, 1, 0))
    squares = total[size:, size:] - total[:-size, size:] - total[size:, :-size] + total[:-size, :-size]
    # rounding errors must not distinguish equal squares
    best = int((squares >= squares.max() - 1e-9 * float(total[-1, -1])).flatten().to(torch.uint8).argmax())
    y, x = divmod(best, squares.shape[1])
    return frames[..., y : y + size, x : x + size]
