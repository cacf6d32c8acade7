"""Inputs of benchmarks: recordings of real sensors from a folder, or synthetic scenes."""

from __future__ import annotations

from contextlib import suppress
from functools import cache
from pathlib import Path

import numpy as np

from nvsdata import formats
from nvsdata.benchmarks.case import Options
from nvsdata.data.events import Events
from nvsdata.transforms.events.crops import resize_events

DIGITS = 34, 34
SENSOR = 240, 180
SECOND = 1_000_000  # µs
WINDOW = 30_000  # µs
VIDEOS = ".mp4", ".avi"


def random_events(count: int, size: tuple[int, int] = SENSOR, *, duration: int = SECOND, seed: int = 0) -> Events:
    """Return events at random pixels and times.

    Args:
        count: Number of events.
        size: (width, height) of the sensor in pixels (default (240, 180)).
        duration: Time span in µs (default 1,000,000).
        seed: Seed of the random numbers (default 0).

    Example:
        >>> len(random_events(5, (34, 34)))
        5
    """
    random = np.random.default_rng(seed)
    t = np.sort(random.integers(0, duration, count))
    x, y, p = (random.integers(0, high, count) for high in (*size, 2))
    return Events(t, x, y, p, size)


def outlines(count: int, *, duration: int = WINDOW, seed: int = 0) -> Events:
    """Return events on the outlines of four moving squares, on 240x180 pixels.

    Args:
        count: Number of events.
        duration: Time span in µs (default 30,000).
        seed: Seed of the random numbers (default 0).
    """
    random = np.random.default_rng(seed)
    t = np.sort(random.integers(0, duration, count))
    side, x, y, vx, vy = (random.uniform(*range_, 4) for range_ in ((20, 50), (0, 180), (0, 120), (0, 9), (0, 9)))
    which, along, edge = random.integers(0, 4, count), random.uniform(0, 1, count), random.integers(0, 4, count)
    across = np.where(edge % 2, along, edge // 2), np.where(edge % 2, edge // 2, along)
    px = x[which] + side[which] * across[0] + vx[which] * t / duration
    py = y[which] + side[which] * across[1] + vy[which] * t / duration
    xs, ys = (np.clip(np.rint(p), 0, top - 1).astype(np.int16) for p, top in zip((px, py), SENSOR, strict=True))
    return Events(t, xs, ys, random.integers(0, 2, count), SENSOR)


def digits(options: Options, count: int = 32) -> list[Events]:
    """Return recordings of N-MNIST from the data folder, or synthetic ones of the same sensor size.

    Args:
        options: Options with the data folder.
        count: Largest number of recordings (default 32).
    """
    if options.data is not None and (paths := _digit_files(options.data)):
        return [formats.read(path, sensor_size=DIGITS) for path in paths[:: max(len(paths) // count, 1)][:count]]
    return [resize_events(outlines(4_000, duration=300_000, seed=seed), *DIGITS) for seed in range(count)]


def sensor_recording(options: Options) -> Events:
    """Return the largest recording of a 240x180 sensor in the data folder, or a synthetic one of 2 s."""
    return (options.data and _largest_recording(options.data)) or outlines(160_000, duration=2 * SECOND)


def video(options: Options) -> Path | None:
    """Return the path of the largest video in the data folder; None if there is none."""
    return next(iter(_by_size(options.data, VIDEOS)), None) if options.data is not None else None


def frame_event_pairs(folder: Path) -> list[Path]:
    """Return the files `pairs/*.npz` below a folder: frames, and the events of the same sensor."""
    return sorted(folder.glob("**/pairs/*.npz"))


def missing_recordings(folder: Path) -> list[str]:
    """Return the names of the kinds of benchmark data that a folder doesn't have."""
    found = {
        "N-MNIST": _digit_files(folder),
        "recording of a 240x180 sensor": _largest_recording(folder),
        "video": _by_size(folder, VIDEOS),
        "pairs of frames and events": frame_event_pairs(folder),
    }
    return [name for name, what in found.items() if not what]


@cache
def _largest_recording(folder: Path) -> Events | None:
    for path in _by_size(folder, (".aedat", ".aedat4", ".h5", ".raw", ".dat")):
        with suppress(ValueError, OSError, ImportError):
            events = formats.read(path)
            if events.sensor_size == SENSOR:
                return events
    return None


@cache
def _digit_files(folder: Path) -> list[Path]:
    roots = [folder] if folder.name == "N-MNIST" else list(folder.rglob("N-MNIST"))
    return sorted(path for root in roots for path in root.rglob("*.bin"))


@cache
def _by_size(folder: Path, suffixes: tuple[str, ...]) -> list[Path]:
    return sorted(
        (path for path in folder.rglob("*") if path.suffix in suffixes), key=lambda path: (-path.stat().st_size, path)
    )
