"""Frames of summed polarity, and crops and stacks of them for convolutional networks (thesis 3.5)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import torch
from torch.nn import functional as F

from nvsdata.common.memory import zeros
from nvsdata.common.validation import positive, whole
from nvsdata.data.events import Events
from nvsdata.data.frame_edges import frame_bounds, frame_edges
from nvsdata.data.recording import Recording, events_inside
from nvsdata.kernels.represent.frames import sum_frames as kernel
from nvsdata.transforms.apply import follow, stay
from nvsdata.transforms.events.crops import downsample
from nvsdata.transforms.rng import place
from nvsdata.transforms.tensors.image import as_image, center_crop, crop


@dataclass(frozen=True)
class SumFrames:
    """Polarity summed at each pixel over frames of 1 / `fps` s (eq. 3.18), averaged over `factor` x `factor` pixels.

    - `fps`: frames per second (default 30.0)
    - `factor`: downsampling of both axes (default 1: none); the thesis uses 8

    Takes `Events` or a `Recording`, gives float32 [frames, H, W]; ON counts +1, OFF -1. The frames cover the time of
    the events (`Events.start` to `end`); there is at least one. Pixels left over at the right and bottom form
    smaller cells. ValueError for settings that aren't positive.
    """

    fps: float = 30.0
    factor: int = 1
    deterministic: ClassVar[bool] = True

    def __post_init__(self) -> None:
        positive("fps", self.fps)
        whole("factor", self.factor, 1)

    def __call__(self, sample: Events | Recording) -> torch.Tensor:
        frames = sum_frames(sample, self.fps, int(self.factor))
        if self.factor > 1:
            follow(sample, lambda boxes: downsample(boxes, int(self.factor)))
        return frames


@dataclass(frozen=True)
class RandomTemporalCrop:
    """`length` consecutive frames from a random place: [frames, H, W] to [length, H, W].

    - `length`: number of frames (default 160, as in the thesis); 3 gives the stack that replaces red, green and blue

    If there are fewer frames, frames of zeros are appended. ValueError for a length that isn't positive.
    """

    length: int = 160

    def __post_init__(self) -> None:
        whole("length", self.length, 1)

    def __call__(self, frames: torch.Tensor) -> torch.Tensor:
        as_image(frames, 1)
        return volume(frames, place(max(frames.shape[0] - int(self.length), 0) + 1), int(self.length))


@dataclass(frozen=True)
class Stacks:
    """Every `length` consecutive frames: [frames, H, W] to [frames - length + 1, length, H, W], a view.

    - `length`: number of frames in a stack (default 3, as in the thesis)

    ValueError for fewer frames than `length`.
    """

    length: int = 3
    deterministic: ClassVar[bool] = True

    def __post_init__(self) -> None:
        whole("length", self.length, 1)

    def __call__(self, frames: torch.Tensor) -> torch.Tensor:
        return stacks(frames, int(self.length))


@dataclass(frozen=True)
class MotionCrop:
    """The square with the most activity, the sum of |f| over all frames: [..., H, W] to [..., size, size].

    - `size`: side in pixels (default 24)

    If several squares are equal, the first one is taken. ValueError for frames smaller than the square.
    """

    size: int = 24
    deterministic: ClassVar[bool] = True

    def __post_init__(self) -> None:
        whole("size", self.size, 1)

    def __call__(self, frames: torch.Tensor) -> torch.Tensor:
        stay("MotionCrop")
        return motion_crop(frames, int(self.size))


@dataclass(frozen=True)
class FourCrops:
    """The crops used for testing in the thesis: [..., H, W] to [4, ..., size, size].

    In this order: the most active square (`MotionCrop`), the same mirrored, the center, the same mirrored.

    - `size`: side in pixels (default 24)

    ValueError for frames smaller than the square.
    """

    size: int = 24
    deterministic: ClassVar[bool] = True

    def __post_init__(self) -> None:
        whole("size", self.size, 1)

    def __call__(self, frames: torch.Tensor) -> torch.Tensor:
        stay("FourCrops")
        return four_crops(frames, int(self.size))


@dataclass(frozen=True)
class MedianDenoise:
    """Median of each pixel and its neighbors to the right, below and diagonally below, borders replicated.

    The median of four values is the mean of the two in the middle, so an isolated spike is removed. Takes and gives
    [..., H, W].
    """

    deterministic: ClassVar[bool] = True

    def __call__(self, frames: torch.Tensor) -> torch.Tensor:
        return median_denoise(frames)


def sum_frames(sample: Events | Recording, fps: float = 30.0, factor: int = 1) -> torch.Tensor:
    """Frames of summed polarity; see `SumFrames`."""
    events = events_inside(sample)
    edges = frame_edges(events.end - events.start, fps)
    bounds = frame_bounds(events, events.start, edges)
    width, height = events.sensor_size
    out = zeros(events.sensor_size, (bounds.size - 1, -(-height // factor), -(-width // factor)))
    kernel(events.x, events.y, events.p, bounds, events.sensor_size, factor, out)
    return torch.from_numpy(out)


def volume(frames: torch.Tensor, start: int, length: int) -> torch.Tensor:
    """`length` frames from index `start` on, padded with zeros at the end: [length, H, W]. See `RandomTemporalCrop`."""
    cut = frames[start : start + length]
    return F.pad(cut, (0, 0) * (cut.ndim - 1) + (0, length - cut.shape[0]))


def stacks(frames: torch.Tensor, length: int = 3) -> torch.Tensor:
    """Every `length` consecutive frames; ValueError if there are fewer. See `Stacks`."""
    if as_image(frames, 1).shape[0] < length:
        raise ValueError(f"{frames.shape[0]} frames make no stack of {length}")
    return frames.unfold(0, length, 1).movedim(-1, 1)


def motion_crop(frames: torch.Tensor, size: int = 24) -> torch.Tensor:
    """The most active square; ValueError for frames smaller than it. See `MotionCrop`."""
    _fits(frames, size)
    activity = frames.abs().reshape(-1, *frames.shape[-2:]).sum(0, dtype=torch.float64)
    # sums of all squares by an integral image
    whole = F.pad(activity.cumsum(0).cumsum(1), (1, 0, 1, 0))
    squares = whole[size:, size:] - whole[:-size, size:] - whole[size:, :-size] + whole[:-size, :-size]
    # rounding errors must not distinguish equal squares
    best = int((squares >= squares.max() - 1e-9 * float(whole[-1, -1])).flatten().to(torch.uint8).argmax())
    y, x = divmod(best, squares.shape[1])
    return crop(frames, x, y, size)


def four_crops(frames: torch.Tensor, size: int = 24) -> torch.Tensor:
    """Most active and center square, each also mirrored; ValueError for frames smaller than it. See `FourCrops`."""
    active = motion_crop(frames, size)
    center = center_crop(frames, size)
    return torch.stack((active, active.flip(-1), center, center.flip(-1)))


def median_denoise(frames: torch.Tensor) -> torch.Tensor:
    """Median of 2 x 2 pixels; see `MedianDenoise`."""
    as_image(frames, floats=True)
    right = torch.cat((frames[..., 1:], frames[..., -1:]), -1)
    pairs = torch.stack((frames, right))
    four = torch.cat((pairs, torch.cat((pairs[..., 1:, :], pairs[..., -1:, :]), -2)))
    return four.sort(0).values[1:3].mean(0)


def _fits(frames: torch.Tensor, size: int) -> None:
    if min(as_image(frames).shape[-2:]) < size:
        raise ValueError(f"frames of {frames.shape[-1]}x{frames.shape[-2]} hold no square of {size}")
