"""A recording to try things on, drawn and emulated on the spot: no file and no download."""

from __future__ import annotations

import cv2
import numpy as np

from nvsdata.data.events import Events
from nvsdata.emulation.dvs import DVS

SIZE = (240, 180)
FPS = 250.0
DURATION = 0.5  # s


def example(seed: int = 0) -> Events:
    """Half a second of a disc, a turning square and a triangle that move over a 240x180 sensor, with some noise.

    Frames are drawn at 250 per second, and seen by `DVS`. The same seed (default 0) gives the same events.
    """
    pixel = DVS(noise_rate=0.5, mismatch=0.03, seed=seed)
    return pixel.emulate((_frame(n / FPS) for n in range(round(DURATION * FPS) + 1)), fps=FPS)


def _frame(seconds: float) -> np.ndarray:
    """The scene, gray uint8 [180, 240]; drawn at four times the size, so that edges lie between pixels."""
    share = seconds / DURATION
    picture = np.full((4 * SIZE[1], 4 * SIZE[0]), 60, np.uint8)
    cv2.circle(picture, _scaled(45 + 130 * share, 50 + 25 * np.sin(2 * np.pi * share)), 4 * 22, 190, -1)
    turn = np.pi / 2 * share + np.array([0.25, 0.75, 1.25, 1.75]) * np.pi
    square = np.stack([70 + 30 * np.cos(turn), 125 + 30 * np.sin(turn)], 1)
    cv2.fillPoly(picture, [np.rint(4 * square).astype(np.int32)], 130)
    corners = np.array([(200, 150), (165, 150), (182, 115)]) - (30 * share, 20 * share)
    cv2.fillPoly(picture, [np.rint(4 * corners).astype(np.int32)], 20)
    return cv2.resize(picture, SIZE, interpolation=cv2.INTER_AREA)


def _scaled(x: float, y: float) -> tuple[int, int]:
    return round(4 * x), round(4 * y)
