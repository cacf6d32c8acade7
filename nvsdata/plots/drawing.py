"""Images by OpenCV: the colors, font and text that all of them share, images of events, and PNG files."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from nvsdata.common.files import put
from nvsdata.data.events import Events

ON, OFF, BOTH = (60, 60, 220), (220, 120, 40), (150, 60, 150)  # BGR
INK, FAINT = (60, 60, 60), (225, 225, 225)
FONT = cv2.FONT_HERSHEY_SIMPLEX


def event_image(events: Events, zoom: int = 1) -> np.ndarray:
    """Draw events on white: pixels with ON events red, with OFF events blue, with both purple.

    Args:
        events: The events. All are drawn, whatever their times.
        zoom: Side in pixels of the square that is drawn for each pixel of the sensor (default 1).

    Returns:
        uint8 [H * zoom, W * zoom, 3], BGR.

    Example:
        >>> events = Events([0, 10], [0, 3], [1, 1], [1, 0], sensor_size=(4, 2))
        >>> event_image(events, zoom=10).shape
        (20, 40, 3)
    """
    width, height = events.sensor_size
    image = np.full((height, width, 3), 255, np.uint8)
    seen = np.zeros((2, height, width), bool)
    seen[events.p, events.y, events.x] = True
    image[seen[1]], image[seen[0]], image[seen[0] & seen[1]] = ON, OFF, BOTH
    return image.repeat(zoom, 0).repeat(zoom, 1)


def middle(events: Events, duration: int) -> Events:
    """Return the events of `duration` µs at the midpoint of the recording."""
    start = (events.start + events.end) // 2 - duration // 2
    return events.window(start, start + duration)


def put_text(
    image: np.ndarray,
    text: str,
    at: tuple[float, float],
    *,
    size: float = 0.45,
    color: tuple[int, int, int] = INK,
    align: float = 0.0,
) -> None:
    """Write a line of text into an image.

    Args:
        image: uint8 [H, W, 3], BGR. It is changed.
        text: The line of text.
        at: Position (x, y) of the text's baseline in pixels.
        size: Scale of the font (default 0.45).
        color: BGR color of the text (default: dark gray).
        align: Fraction of the text's width that is left of x (default 0; 0.5 centers the text).
    """
    x, y = at[0] - align * text_width(text, size), at[1]
    cv2.putText(image, text, (round(x), round(y)), FONT, size, color, 1, cv2.LINE_AA)


def text_width(text: str, size: float = 0.45) -> int:
    """Return the width of a line of text in pixels."""
    return int(cv2.getTextSize(text, FONT, size, 1)[0][0])


def shortened(text: str, width: int, size: float = 0.45) -> str:
    """Return the text, or its beginning and two dots if it is wider than `width` pixels."""
    if not text or text_width(text, size) <= width:
        return text
    while text and text_width(text + "..", size) > width:
        text = text[:-1]
    return text + ".."


def save_png(image: np.ndarray, path: Path) -> None:
    """Write an image as a PNG file, which is complete or missing, never partial.

    Args:
        image: uint8 [H, W], or [H, W, 3] in BGR.
        path: The file. If it is a link, its target is replaced.

    Example:
        >>> import tempfile
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     save_png(np.zeros((4, 4), np.uint8), Path(folder) / "black.png")
    """
    put(path, cv2.imencode(".png", image)[1].tobytes(), through_link=True)
