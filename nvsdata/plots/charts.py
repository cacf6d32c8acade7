"""Values against steps."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from nvsdata.plots.drawing import BOTH, FAINT, FONT, INK, OFF, ON


def curves(
    lines: Sequence[tuple[str, Sequence[float]]],
    title: str,
    xlabel: str,
    size: tuple[int, int] = (720, 420),
    highest: float = 1.0,
    ends: tuple[float, float] | None = None,
) -> np.ndarray:
    """Lines of values against their number, uint8 [H, W, 3], BGR.

    - `lines`: names and values of up to three lines (a fourth and further ones aren't drawn)
    - `title`, `xlabel`: drawn above the lines and below the axis
    - `size`: (width, height) of the picture in pixels (default (720, 420))
    - `highest`: the largest value that fits, the least is 0 (default 1)
    - `ends`: what the first and the last value are at, evenly in between (default: 1, 2, 3 and so on)
    """
    width, height = size
    left, right, top, bottom = 60, 24, 44, 52
    picture = np.full((height, width, 3), 255, np.uint8)
    longest = max(max(len(values) for _, values in lines), 2)

    def place(i: float, value: float) -> tuple[int, int]:
        x = left + (width - left - right) * i / (longest - 1)
        return round(x), round(height - bottom - (height - top - bottom) * value / highest)

    for tick in range(0, 11, 2):
        x, y = place(0, highest * tick / 10)
        cv2.line(picture, (x, y), (width - right, y), FAINT, 1)
        cv2.putText(picture, f"{highest * tick / 10:.2g}", (18, y + 5), FONT, 0.45, INK, 1, cv2.LINE_AA)
    for i in sorted({0, (longest - 1) // 2, longest - 1}):
        x, y = place(i, 0)
        name = str(i + 1) if ends is None else f"{ends[0] + (ends[1] - ends[0]) * i / (longest - 1):.3g}"
        cv2.putText(picture, name, (x - 6, y + 20), FONT, 0.45, INK, 1, cv2.LINE_AA)
    cv2.putText(picture, title, (left, 26), FONT, 0.55, INK, 1, cv2.LINE_AA)
    cv2.putText(picture, xlabel, (width // 2 - 24, height - 10), FONT, 0.45, INK, 1, cv2.LINE_AA)
    for (name, values), color, row in zip(lines, (OFF, ON, BOTH), range(3), strict=False):
        points = np.array([place(i, v) for i, v in enumerate(values)], np.int32)
        cv2.polylines(picture, [points], False, color, 2, cv2.LINE_AA)
        y = 16 + 16 * row
        cv2.line(picture, (width - 190, y - 4), (width - 165, y - 4), color, 2, cv2.LINE_AA)
        cv2.putText(picture, name, (width - 158, y), FONT, 0.45, INK, 1, cv2.LINE_AA)
    return picture
