"""Colors and font that all pictures share, and how they are saved."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from nvsdata.common.files import atomic

ON, OFF, BOTH = (60, 60, 220), (220, 120, 40), (150, 60, 150)  # BGR
INK, FAINT = (60, 60, 60), (225, 225, 225)
FONT = cv2.FONT_HERSHEY_SIMPLEX


def save(picture: np.ndarray, path: Path) -> None:
    """Write a picture, uint8 [H, W] or [H, W, 3] in BGR, as a PNG; the file appears whole or not at all."""
    encoded = cv2.imencode(".png", picture)[1]
    with atomic(path) as temporary:
        temporary.write_bytes(encoded.tobytes())
