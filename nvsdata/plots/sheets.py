"""Many small pictures on one sheet."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from nvsdata.plots.drawing import FONT, INK, ON, shortened, words


def contact_sheet(rows: Sequence[tuple[str, Sequence[np.ndarray]]], gap: int = 8, margin: int = 90) -> np.ndarray:
    """Images of one size in rows, each row with its name on the left; uint8 [H, W, 3], BGR.

    - `rows`: name of each row and its images, uint8 [h, w, 3], BGR
    - `gap`: pixels between images (default 8)
    - `margin`: pixels on the left, for the names (default 90)
    """
    height, width = rows[0][1][0].shape[:2]
    columns = max(len(images) for _, images in rows)
    sheet = np.full((gap + len(rows) * (height + gap), margin + columns * (width + gap), 3), 240, np.uint8)
    for r, (name, images) in enumerate(rows):
        top = gap + r * (height + gap)
        cv2.putText(sheet, name, (8, top + height // 2 + 4), FONT, 0.45, INK, 1, cv2.LINE_AA)
        for c, image in enumerate(images):
            left = margin + c * (width + gap)
            sheet[top : top + height, left : left + width] = image
    return sheet


def captioned_sheet(
    tiles: Sequence[tuple[np.ndarray, Sequence[str]]], columns: int = 8, side: int = 176, gap: int = 12
) -> np.ndarray:
    """Images of any sizes, each with lines of text below, the second one red; uint8 [H, W, 3], BGR.

    - `tiles`: images, uint8 [h, w, 3], BGR, and their lines, from left to right and then down
    - `columns`: at most so many side by side (default 8)
    - `side`: pixels of the square that an image is scaled to fit (default 176)
    - `gap`: pixels between tiles (default 12)
    """
    line, count = 16, max(len(lines) for _, lines in tiles)
    columns = min(columns, len(tiles))
    width, height = side + gap, side + line * count + gap + 4
    sheet = np.full((gap + height * -(-len(tiles) // columns), gap + width * columns, 3), 240, np.uint8)
    for n, (image, lines) in enumerate(tiles):
        top, left = gap + n // columns * height, gap + n % columns * width
        fitted = _fitted(image, side)
        y, x = top + (side - fitted.shape[0]) // 2, left + (side - fitted.shape[1]) // 2
        sheet[top : top + side, left : left + side] = 255
        sheet[y : y + fitted.shape[0], x : x + fitted.shape[1]] = fitted
        for i, text in enumerate(lines):
            at, color = (left, top + side + line * (i + 1)), ON if i == 1 else INK
            words(sheet, shortened(text, side, 0.4), at, size=0.4, color=color)
    return sheet


def _fitted(image: np.ndarray, side: int) -> np.ndarray:
    """The image scaled to a square of `side` pixels: up by whole numbers, down as much as is needed."""
    height, width = image.shape[:2]
    if max(height, width) <= side:
        zoom = side // max(height, width)
        return image.repeat(zoom, 0).repeat(zoom, 1)
    scale = side / max(height, width)
    size = max(1, round(width * scale)), max(1, round(height * scale))
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA))
