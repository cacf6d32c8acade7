"""A picture of a video and its time."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from nvsdata.video.decoder import FULL


class Frame(NamedTuple):
    """A picture and its time.

    - `time`: µs
    - `pixels`: [H, W] or [H, W, 3]; uint8, or float64 from 0 to 255
    - `red_first`: whether colors are red, green, blue, not blue, green, red (default False)
    - `levels`: the values of black and white in gray bytes (default (0, 255))
    - `whole`: whether the video has it; if not, it was made between two that it has (default True)
    """

    time: int
    pixels: np.ndarray
    red_first: bool = False
    levels: tuple[int, int] = FULL
    whole: bool = True


def picture(frame: np.ndarray, name: str) -> np.ndarray:
    """A frame as emulators take it; ValueError, by its `name`, for shapes and types that aren't a picture's."""
    if frame.ndim == 3 and frame.shape[2] == 1:
        frame = frame[..., 0]
    if 0 in frame.shape or not (frame.ndim == 2 or (frame.ndim == 3 and frame.shape[2] in (3, 4))):
        raise ValueError(f"{name} has shape {frame.shape}; it must be [H, W], or [H, W, 3] or [H, W, 4]")
    frame = frame[..., :3] if frame.ndim == 3 else frame
    if frame.dtype == np.uint16:
        frame = frame / 257
    elif frame.dtype == bool:
        frame = frame.astype(np.uint8) * np.uint8(255)
    elif frame.dtype.kind == "f":
        if not (np.isfinite(frame).all() and frame.min() >= 0 and frame.max() <= 1):
            raise ValueError(f"{name}: floats must lie in [0, 1]")
        frame = frame.astype(np.float64) * 255
    elif frame.dtype != np.uint8:
        raise ValueError(f"{name} is {frame.dtype}; it must be uint8, uint16, bool or float")
    return frame
