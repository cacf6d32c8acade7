"""Sheets of many small images."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from nvsdata.data.events import Events
from nvsdata.plots.drawing import FONT, INK, ON, event_image, put_text, shortened

MOMENTS = 6  # images of each recording in `side_by_side`
LEAST_WIDTH = 160  # pixels; images of smaller sensors are enlarged


def contact_sheet(rows: Sequence[tuple[str, Sequence[np.ndarray]]], gap: int = 8, margin: int = 90) -> np.ndarray:
    """Arrange images of one size in rows, each row with its name on the left.

    Args:
        rows: Name and images of each row, uint8 [h, w, 3], BGR.
        gap: Pixels between images (default 8).
        margin: Pixels on the left, for the names (default 90).

    Returns:
        uint8 [H, W, 3], BGR.

    Example:
        >>> image = np.zeros((20, 30, 3), np.uint8)
        >>> contact_sheet([("first", [image, image]), ("second", [image])]).shape
        (64, 166, 3)
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
    """Arrange images of any sizes, each with lines of text below it. The second line is red.

    Args:
        tiles: Images, uint8 [h, w, 3], BGR, and their lines of text, row by row.
        columns: Largest number of tiles in a row (default 8).
        side: Side in pixels of the square that each image is scaled to fit (default 176).
        gap: Pixels between tiles (default 12).

    Returns:
        uint8 [H, W, 3], BGR.

    Example:
        >>> captioned_sheet([(np.zeros((20, 30, 3), np.uint8), ["cat", "wrong"])]).shape
        (236, 200, 3)
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
            put_text(sheet, shortened(text, side, 0.4), at, size=0.4, color=color)
    return sheet


def side_by_side(a: Events, b: Events, fps: float, offset: int = 0) -> np.ndarray:
    """Draw two recordings at the same six moments, in two rows.

    Args:
        a: Events of the upper row.
        b: Events of the lower row.
        fps: Each image shows the events of 1 / `fps` s.
        offset: Time in µs that is added to the times of `b` (default 0).

    Returns:
        uint8 [H, W, 3], BGR.
    """
    origins = (a.start, b.start - offset)
    span = max(events.end - origin for events, origin in zip((a, b), origins, strict=True))
    length = round(1e6 / fps)
    starts = np.linspace(0, max(span - length, 0), MOMENTS).astype(int).tolist()
    zoom = max(1, LEAST_WIDTH // a.sensor_size[0])
    rows = [
        (name, [event_image(events.window(origin + s, origin + s + length), zoom) for s in starts])
        for name, events, origin in zip("AB", (a, b), origins, strict=True)
    ]
    return contact_sheet(rows, margin=24)


def _fitted(image: np.ndarray, side: int) -> np.ndarray:
    """Scale an image to fit a square of `side` pixels: up by a whole factor, down by any factor."""
    height, width = image.shape[:2]
    if max(height, width) <= side:
        zoom = side // max(height, width)
        return image.repeat(zoom, 0).repeat(zoom, 1)
    scale = side / max(height, width)
    size = max(1, round(width * scale)), max(1, round(height * scale))
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA))
