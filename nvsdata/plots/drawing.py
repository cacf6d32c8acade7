"""Colors, font and words that all pictures share, and how they are saved."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from nvsdata.common.files import put

ON, OFF, BOTH = (60, 60, 220), (220, 120, 40), (150, 60, 150)  # BGR
INK, FAINT = (60, 60, 60), (225, 225, 225)
FONT = cv2.FONT_HERSHEY_SIMPLEX


def words(
    picture: np.ndarray,
    text: str,
    at: tuple[float, float],
    *,
    size: float = 0.45,
    color: tuple[int, int, int] = INK,
    align: float = 0.0,
) -> None:
    """Write a line of text into a picture.

    - `at`: (x, y) of its base line in pixels
    - `size`: of the font (default 0.45)
    - `color`: BGR
    - `align`: share of the text that lies left of x (default 0; 0.5 centers it)
    """
    x, y = at[0] - align * width_of(text, size), at[1]
    cv2.putText(picture, text, (round(x), round(y)), FONT, size, color, 1, cv2.LINE_AA)


def width_of(text: str, size: float = 0.45) -> int:
    """Width of a line of text in pixels."""
    return int(cv2.getTextSize(text, FONT, size, 1)[0][0])


def shortened(text: str, width: int, size: float = 0.45) -> str:
    """The text, or as much of its beginning as fits `width` pixels, and dots."""
    if not text or width_of(text, size) <= width:
        return text
    while text and width_of(text + "..", size) > width:
        text = text[:-1]
    return text + ".."


def save(picture: np.ndarray, path: Path) -> None:
    """Write a picture, uint8 [H, W] or [H, W, 3] in BGR, as a PNG; the file appears whole or not at all."""
    put(path, cv2.imencode(".png", picture)[1].tobytes(), through_link=True)
