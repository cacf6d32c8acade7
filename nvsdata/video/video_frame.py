"""A frame of a video, and the conversion of arrays and image files to its pixels."""

from __future__ import annotations

import os
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np

from nvsdata.common.errors import FormatError

FULL, STUDIO = (0, 255), (16, 235)  # byte values of black and white: full range, and limited range as in TV studios


class VideoFrame(NamedTuple):
    """A frame of a video.

    Args:
        time: Time in µs.
        pixels: Gray [H, W] or colors [H, W, 3], uint8, or float64 from 0 to 255.
        red_first: Whether the order of colors is red, green, blue; else it is blue, green, red.
        levels: Values of black and white in gray pixels of uint8.
        whole: False for a frame that upsampling made between two frames of the video.

    Example:
        >>> VideoFrame(40_000, np.zeros((48, 64), np.uint8)).pixels.shape
        (48, 64)
    """

    time: int
    pixels: np.ndarray
    red_first: bool = False
    levels: tuple[int, int] = FULL
    whole: bool = True


def as_pixels(array: np.ndarray, name: str) -> np.ndarray:
    """Convert an array to the pixels of a `VideoFrame`.

    Args:
        array: [H, W], [H, W, 1], [H, W, 3] or [H, W, 4] of uint8, uint16, bool, or floats in [0, 1].
        name: Name of the frame in error messages.

    Raises:
        ValueError: The shape, the type or a value isn't one of these.

    Example:
        >>> float(as_pixels(np.ones((2, 2), np.float32), "frame 0").max())
        255.0
    """
    if array.ndim == 3 and array.shape[2] == 1:
        array = array[..., 0]
    if 0 in array.shape or not (array.ndim == 2 or (array.ndim == 3 and array.shape[2] in (3, 4))):
        raise ValueError(f"{name} has shape {array.shape}; it must be [H, W], or [H, W, 3] or [H, W, 4]")
    array = array[..., :3] if array.ndim == 3 else array
    if array.dtype == np.uint16:
        array = array / 257
    elif array.dtype == bool:
        array = array.astype(np.uint8) * np.uint8(255)
    elif array.dtype.kind == "f":
        if not (np.isfinite(array).all() and array.min() >= 0 and array.max() <= 1):
            raise ValueError(f"{name}: floats must be in [0, 1]")
        array = array.astype(np.float64) * 255
    elif array.dtype != np.uint8:
        raise ValueError(f"{name} is {array.dtype}; it must be uint8, uint16, bool or float")
    return array


def read_image(path: str | os.PathLike[str], name: str) -> np.ndarray:
    """Read the pixels of an image file, with colors in the order blue, green, red; errors call the frame `name`."""
    check_name(path)
    pixels = cv2.imread(os.fspath(path), cv2.IMREAD_UNCHANGED)
    if pixels is not None:
        return as_pixels(pixels, name)
    if not Path(path).exists():
        raise FileNotFoundError(f"{path}: no such image")
    raise FormatError(path, "contains no image that OpenCV can decode")


def check_name(path: str | os.PathLike[str]) -> None:
    """Raise FormatError for a file name that isn't UTF-8: OpenCV would crash the process."""
    try:
        os.fspath(path).encode()
    except UnicodeEncodeError:
        raise FormatError(path, "a name that isn't UTF-8, which OpenCV can't open: rename the file") from None


def rgb_luminance(r: np.ndarray, g: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the luminance q = 0.299 r + 0.587 g + 0.114 b (thesis, section 3.2.1), float64."""
    return np.asarray((299 * r + 587 * g + 114 * b) / 1000)


def stretch_levels(luma: np.ndarray, levels: tuple[int, int]) -> np.ndarray:
    """Return the brightness, float64 from 0 to 255, of luma in which black and white have the values `levels`."""
    black, white = levels
    return np.clip((luma.astype(np.float64) - black) * 255 / (white - black), 0, 255)
