"""Synthetic example recording, without a file or download."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from nvsdata.data.events import Events
from nvsdata.emulation.dvs import DVS

SIZE = (240, 180)
FPS = 250.0
DURATION = 0.5  # s
FINE = 2  # points per pixel along each axis, for antialiased edges


def example(seed: int = 0) -> Events:
    """Return events of a disc, a turning square and a triangle that move over a 240x180 sensor, with some noise.

    The scene lasts half a second. It is drawn at 250 frames per second and converted by `DVS`.

    Args:
        seed: Seed of the noise; the same seed gives the same events.

    Example:
        >>> example().sensor_size
        (240, 180)
    """
    return DVS(noise_rate=0.5, mismatch=0.03, seed=seed).emulate(example_frames(), fps=FPS)


def example_frames() -> Iterator[np.ndarray]:
    """Yield the frames, gray uint8 [180, 240]; drawn point by point, so that they are the same on all systems."""
    for share in np.linspace(0, 1, round(DURATION * FPS) + 1):
        canvas = np.full((FINE * SIZE[1], FINE * SIZE[0]), 60, np.int16)
        disc = 45 + 130 * share, 50 + 25 * np.sin(2 * np.pi * share)
        part, x, y = _around(canvas, np.array([disc]), 22)
        part[(x - disc[0]) ** 2 + (y - disc[1]) ** 2 <= 22**2] = 190
        turn = np.pi / 2 * (share + np.arange(4))
        _fill(canvas, np.stack([70 + 30 * np.cos(turn), 125 + 30 * np.sin(turn)], 1), 130)
        _fill(canvas, np.array([(165, 150), (182, 115), (200, 150)]) - (30 * share, 20 * share), 20)
        total = sum(canvas[row::FINE, column::FINE] for row in range(FINE) for column in range(FINE))
        yield np.rint(total / FINE**2).astype(np.uint8)


def _around(canvas: np.ndarray, corners: np.ndarray, margin: int = 0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the part of the canvas around `corners`, with x [1, W] and y [H, 1] of its points in pixels."""
    low = np.floor(FINE * (corners.min(0) - margin)).astype(int)
    high = np.ceil(FINE * (corners.max(0) + margin)).astype(int)
    x, y = ((np.arange(*side, dtype=np.float32) + 0.5) / FINE for side in zip(low, high, strict=True))
    return canvas[low[1] : high[1], low[0] : high[0]], x[None, :], y[:, None]


def _fill(canvas: np.ndarray, corners: np.ndarray, value: int) -> None:
    """Fill a convex polygon with a gray value; its corners are clockwise in image coordinates."""
    part, x, y = _around(canvas, corners)
    within = np.ones(part.shape, np.bool_)
    for (x0, y0), (x1, y1) in zip(corners, np.roll(corners, -1, 0), strict=True):
        within &= (x1 - x0) * (y - y0) - (y1 - y0) * (x - x0) >= 0
    part[within] = value
