"""One value at each of a few settings."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from nvsdata.plots.drawing import FAINT, OFF, words

WIDTH, HEIGHT = 720, 420  # pixels
LEFT, RIGHT, TOP, BOTTOM = 90, 60, 60, 60  # what lies around the points
MOST_WRITTEN = 12


def marked(values: Sequence[float], names: Sequence[str], title: str, xlabel: str) -> np.ndarray:
    """Shares, joined by a line, each with its number; uint8 [H, W, 3], BGR.

    The axis ends at 1 and begins at the tenth below the least value. Of more than 12 values, some are written.

    - `values`: from 0 to 1
    - `names`: what each belongs to, written below; they lie at even distances
    - `title`, `xlabel`: drawn above and below
    """
    picture = np.full((HEIGHT, WIDTH, 3), 255, np.uint8)
    floor = min(int(min(values) * 10) / 10, 0.9)

    def place(i: int, value: float) -> tuple[int, int]:
        x = LEFT + (WIDTH - LEFT - RIGHT) * i / max(len(values) - 1, 1)
        return round(x), round(HEIGHT - BOTTOM - (HEIGHT - TOP - BOTTOM) * (value - floor) / (1 - floor))

    step = 0.1 if floor < 0.65 else 0.05 if floor < 0.85 else 0.02
    for tick in np.linspace(floor, 1, round((1 - floor) / step) + 1).tolist():
        y = place(0, tick)[1]
        cv2.line(picture, (LEFT - 24, y), (WIDTH - RIGHT + 24, y), FAINT, 1)
        words(picture, f"{tick:.2f}", (LEFT - 32, y + 5), align=1)
    points = [place(i, value) for i, value in enumerate(values)]
    cv2.polylines(picture, [np.array(points, np.int32)], False, OFF, 2, cv2.LINE_AA)
    every = -(-len(values) // MOST_WRITTEN)
    for i in range(0, len(values), every):
        x, y = points[i]
        cv2.circle(picture, (x, y), 4, OFF, -1, cv2.LINE_AA)
        words(picture, f"{values[i]:.3f}", (x, y - 10), size=0.42, align=0.5)
        words(picture, names[i], (x, HEIGHT - BOTTOM + 22), align=0.5)
    words(picture, title, (LEFT - 24, 26), size=0.55)
    words(picture, xlabel, (WIDTH / 2, HEIGHT - 10), align=0.5)
    return picture
