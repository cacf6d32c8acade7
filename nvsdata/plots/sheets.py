"""Many small pictures on one sheet."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from nvsdata.plots.drawing import FONT, INK


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
