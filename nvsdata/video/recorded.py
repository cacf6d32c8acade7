"""Frames with times in a camera's own clock: those inside recordings, and folders of images with a list of times."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np

from nvsdata.common.errors import FormatError
from nvsdata.data.recording import Recording
from nvsdata.data.samples import Frame as Sample
from nvsdata.video.picture import Frame, picture

IMAGES = {".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".pgm", ".ppm"}
LISTS = ("images.txt", "timestamps.txt", "image_timestamps.txt", "timestamp.txt")
LONGEST = 2_000_000  # µs between frames: whole numbers that are further apart count ns
DEPTHS = (8, 10, 12, 16)  # bits of cameras' pixels


def of_recording(recording: Recording) -> Iterator[Frame]:
    """A recording's own frames, in the middle of their exposure, as the events count time (µs).

    Their brightest value tells how many bits they have. ValueError for a recording without frames, frames that don't
    show the whole sensor, and times that don't rise.
    """
    samples = list(recording.frames())
    if not samples:
        raise ValueError(f"{recording} has no frames")
    brightest = max(int(sample.pixels.max(initial=0)) for sample in samples)
    white = 2 ** next(bits for bits in DEPTHS if brightest < 2**bits) - 1
    last = None
    for n, sample in enumerate(samples):
        time = _middle(sample)
        height, width = sample.pixels.shape
        if (width, height) != recording.sensor_size:
            raise ValueError(f"frame {n} is {width}x{height}, the sensor {recording.sensor_size}: take whole frames")
        if last is not None and time <= last:
            raise ValueError(f"frame {n} is of {time} µs, the one before of {last}: times must rise")
        last = time
        yield Frame(time, sample.pixels.astype(np.uint8) if white == 255 else sample.pixels * (255.0 / white))


def _middle(sample: Sample) -> int:
    return sample.exposure_start + (sample.exposure_end - sample.exposure_start) // 2


def of_folder(folder: Path) -> Iterator[Frame]:
    """A folder's images and the times that a list beside them states, in µs.

    The list is `images.txt`, a time and a name per line, or `timestamps.txt`, a time per line for the images sorted by
    number. Times with a decimal point are seconds, whole ones µs, or ns if that puts frames over 2 s apart.
    FormatError for a folder without images or without times, lines that aren't times, other numbers of them, and times
    that don't rise.
    """
    listed = next((folder / name for name in LISTS if (folder / name).exists()), None)
    if listed is None:
        raise FormatError(folder, f"is a folder without times of its images: none of {', '.join(LISTS)}")
    names, times = _read(listed)
    found = names or _by_number(folder, len(times))
    for time, name in zip(times, found, strict=True):
        path = folder / name
        pixels = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
        if pixels is None:
            raise FormatError(
                path, "holds no image that OpenCV can decode" if path.exists() else "is listed, not there"
            )
        yield Frame(time, picture(pixels, path.name))


def _by_number(folder: Path, count: int) -> list[str]:
    """The names of a folder's images, in the order of the numbers in them."""
    images = [path for path in folder.iterdir() if path.suffix.lower() in IMAGES]
    images = images or [path for path in (folder / "images").glob("*") if path.suffix.lower() in IMAGES]
    if len(images) != count:
        raise FormatError(folder, f"has {len(images)} images and {count} times")
    return [path.relative_to(folder).as_posix() for path in sorted(images, key=_number)]


def _number(path: Path) -> tuple[list[int], str]:
    return [int(digits) for digits in re.findall(r"\d+", path.stem)], path.name


def _read(listed: Path) -> tuple[list[str], list[int]]:
    """Names, if there are any, and times in µs."""
    names, texts = [], []
    for n, line in enumerate(listed.read_text("utf-8").splitlines(), 1):
        words = line.partition("#")[0].replace(",", " ").split()
        if not words:
            continue
        numbers = [word for word in words if re.fullmatch(r"[-+]?\d+(\.\d*)?([eE][-+]?\d+)?", word)]
        if not numbers or len(words) > 2:
            raise FormatError(listed, f"line {n} is {line!r}, not a time, with a name or without")
        # of two numbers, the first counts the frames
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
            raise FormatError(listed, f"time {n} is {after} µs, the one before {before}: times must rise")
    return times


def _of_seconds(text: str) -> int:
    """µs of decimal seconds, exactly where float64 would round: times may be seconds since 1970."""
    if "e" in text.lower():
        return round(float(text) * 1e6)
    whole, _, fraction = text.lstrip("+-").partition(".")
    value = int(whole) * 10**6 + math.floor(int((fraction + "0" * 7)[:7]) / 10 + 0.5)
    return -value if text.startswith("-") else value
