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

    Frames of half a second are drawn at 250 per second and converted by `DVS`.

    Args:
        seed: Seed of the noise; the same seed gives the same events.

    Example:
        >>> example().sensor_size
        (240, 180)
    """
    return DVS(noise_rate=0.5, mismatch=0.03, seed=seed).emulate(_frames(), fps=FPS)


def _frames() -> Iterator[np.ndarray]:
    """Yield the frames, gray uint8 [180, 240]; drawn point by point, so that they are the same on all systems."""
    x, y = ((np.arange(FINE * side, dtype=np.float32) + 0.5) / FINE for side in SIZE)
    x, y = x[None, :], y[:, None]
    for share in np.linspace(0, 1, round(DURATION * FPS) + 1):
        canvas = np.full((y.size, x.size), 60.0, np.float32)
        disc = 45 + 130 * share, 50 + 25 * np.sin(2 * np.pi * share)
        canvas[(x - disc[0]) ** 2 + (y - disc[1]) ** 2 <= 22**2] = 190
        turn = np.pi / 2 * (share + np.arange(4))
        canvas[_inside(x, y, np.stack([70 + 30 * np.cos(turn), 125 + 30 * np.sin(turn)], 1))] = 130
        canvas[_inside(x, y, np.array([(165, 150), (182, 115), (200, 150)]) - (30 * share, 20 * share))] = 20
        fine = canvas.reshape(SIZE[1], FINE, SIZE[0], FINE)
        yield np.rint(fine.mean((1, 3))).astype(np.uint8)


def _inside(x: np.ndarray, y: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Return whether points are inside a convex polygon, whose corners are clockwise in image coordinates."""
    within = np.ones((y.size, x.size), np.bool_)
    for (x0, y0), (x1, y1) in zip(corners, np.roll(corners, -1, 0), strict=True):
        within &= (x1 - x0) * (y - y0) - (y1 - y0) * (x - x0) >= 0
    return within
