"""Frames with times in a camera's own clock, from recordings and from folders of images with a list of times."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import numpy as np

from nvsdata.common.errors import FormatError
from nvsdata.data.recording import Recording
from nvsdata.video.video_frame import VideoFrame, read_image

IMAGES = {".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".pgm", ".ppm"}
LISTS = ("images.txt", "timestamps.txt", "image_timestamps.txt", "timestamp.txt")
LONGEST = 2_000_000  # µs between frames; times in whole numbers that would be further apart are in ns
DEPTHS = (8, 10, 12, 16)  # bits per pixel of cameras


def read_recording(recording: Recording) -> Iterator[VideoFrame]:
    """Yield a recording's own frames, at the midpoint of their exposure in the events' clock (µs).

    The brightest value of all frames determines the number of bits per pixel: 8, 10, 12 or 16.

    Raises:
        ValueError: The recording has no frames, a frame doesn't show the entire sensor, or times don't rise.
    """
    samples = list(recording.frames())
    if not samples:
        raise ValueError(f"{recording} has no frames")
    brightest = max(int(sample.pixels.max(initial=0)) for sample in samples)
    white = 2 ** next(bits for bits in DEPTHS if brightest < 2**bits) - 1
    last = None
    for n, sample in enumerate(samples):
        time = sample.exposure_start + (sample.exposure_end - sample.exposure_start) // 2
        height, width = sample.pixels.shape
        if (width, height) != recording.sensor_size:
            raise ValueError(
                f"frame {n} is {width}x{height}, the sensor {recording.sensor_size}: take frames of the entire sensor"
            )
        if last is not None and time <= last:
            raise ValueError(f"frame {n} is at {time} µs, the one before at {last}: times must rise")
        last = time
        yield VideoFrame(time, sample.pixels.astype(np.uint8) if white == 255 else sample.pixels * (255.0 / white))


def read_folder(folder: Path) -> Iterator[VideoFrame]:
    """Yield a folder's images at the times (µs) that a list in the folder states.

    The list is `images.txt`, with a time and a name per line, or `timestamps.txt`, with a time per line for the images
    sorted by the numbers in their names. Times with a decimal point are in s. Whole numbers are in µs, or in ns if
    frames would be more than 2 s apart otherwise.

    Raises:
        FormatError: There are no images or no times, their numbers differ, a line isn't a time, or times don't rise.
    """
    listed = next((folder / name for name in LISTS if (folder / name).exists()), None)
    if listed is None:
        raise FormatError(folder, f"is a folder without times of its images: none of {', '.join(LISTS)}")
    names, times = _read(listed)
    found = names or _by_number(folder, len(times))
    for time, name in zip(times, found, strict=True):
        path = folder / name
        if not path.exists():
            raise FormatError(path, "is listed, but missing")
        yield VideoFrame(time, read_image(path, path.name))


def _by_number(folder: Path, count: int) -> list[str]:
    """Return the names of a folder's images, sorted by the numbers in them."""
    images = [path for path in folder.iterdir() if path.suffix.lower() in IMAGES]
    images = images or [path for path in (folder / "images").glob("*") if path.suffix.lower() in IMAGES]
    if len(images) != count:
        raise FormatError(folder, f"has {len(images)} images and {count} times")
    return [path.relative_to(folder).as_posix() for path in sorted(images, key=_number)]


def _number(path: Path) -> tuple[list[int], str]:
    return [int(digits) for digits in re.findall(r"\d+", path.stem)], path.name


def _read(listed: Path) -> tuple[list[str], list[int]]:
    """Return the names in a list, if it has any, and its times in µs."""
    names, texts = [], []
    for n, line in enumerate(listed.read_text("utf-8").splitlines(), 1):
        words = line.partition("#")[0].replace(",", " ").split()
        if not words:
            continue
        numbers = [word for word in words if re.fullmatch(r"[-+]?\d+(\.\d*)?([eE][-+]?\d+)?", word)]
        if not numbers or len(words) > 2:
            raise FormatError(listed, f"line {n} is {line!r}, not a time, with a name or without")
        # the first of two numbers is the number of the frame, the second its time
        texts.append(numbers[-1])
        names += [word for word in words if word not in numbers]
    if not texts:
        raise FormatError(listed, "has no times")
    if names and len(names) != len(texts):
        raise FormatError(listed, f"has {len(names)} names and {len(texts)} times")
    return names, _microseconds(listed, texts)


def _microseconds(listed: Path, texts: list[str]) -> list[int]:
    if any(not text.lstrip("+-").isdecimal() for text in texts):
        times = [_of_seconds(text) for text in texts]
    else:
        times = [int(text) for text in texts]
        gaps = sorted(b - a for a, b in pairwise(times))
        if gaps and gaps[len(gaps) // 2] > LONGEST:
            times = [time // 1000 for time in times]
    for n, (before, after) in enumerate(pairwise(times), 1):
        if after <= before:
            raise FormatError(listed, f"time {n} is {after} µs, the one before is {before}: times must rise")
    return times


def _of_seconds(text: str) -> int:
    """Convert a decimal number of seconds to µs, exactly: float64 would round seconds since 1970."""
    if "e" in text.lower():
        return round(float(text) * 1e6)
    whole, _, fraction = text.lstrip("+-").partition(".")
    value = int(whole) * 10**6 + math.floor(int((fraction + "0" * 7)[:7]) / 10 + 0.5)
    return -value if text.startswith("-") else value
