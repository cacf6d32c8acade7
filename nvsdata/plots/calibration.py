"""Whether a classifier is as often right as it says."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from nvsdata.plots.drawing import FAINT, INK, OFF, ON, words

Bins = tuple[np.ndarray, np.ndarray, np.ndarray, float]
"""Of each bin: count, mean confidence, accuracy [bins]; and the expected calibration error."""

SIDE, PILE = 320, 70  # pixels of a diagram, and of the counts below
LEFT, TOP, GAP = 54, 66, 30


def reliability(kinds: Sequence[tuple[str, Bins]]) -> np.ndarray:
    """Reliability diagrams side by side; uint8 [H, W, 3], BGR.

    Blue bars are the accuracy of each bin, from left to right by confidence; the red stroke across is its mean
    confidence, where the bar would end if that were true. Below: the share of predictions in each bin.

    - `kinds`: name of each, and its bins, such as `metrics.calibration` gives
    """
    panels = [_panel(name, bins) for name, bins in kinds]
    return np.concatenate(panels, 1)


def _panel(name: str, bins: Bins) -> np.ndarray:
    count, confidence, accuracy, error = bins
    picture = np.full((TOP + SIDE + GAP + PILE + 44, LEFT + SIDE + 24, 3), 255, np.uint8)
    floor, base = TOP + SIDE, TOP + SIDE + GAP + PILE
    words(picture, f"{name}: expected calibration error {error:.3f}", (12, 24), size=0.48)
    for tick in (0.0, 0.2, 0.4, 0.6, 0.8, 1.0):
        x, y = LEFT + round(tick * SIDE), floor - round(tick * SIDE)
        cv2.line(picture, (LEFT, y), (LEFT + SIDE, y), FAINT, 1)
        words(picture, f"{tick:.1f}", (LEFT - 8, y + 4), size=0.38, align=1)
        words(picture, f"{tick:.1f}", (x, base + 16), size=0.38, align=0.5)
    edges = LEFT + np.arange(len(count) + 1) * SIDE / len(count)
    most = max(count.max(), 1)
    for left, right, n, sure, share in zip(edges[:-1], edges[1:], count, confidence, accuracy, strict=True):
        if not n:
            continue
        x0, x1 = round(left) + 1, round(right) - 1
        cv2.rectangle(picture, (x0, floor - round(share * SIDE)), (x1, floor), OFF, -1)
        y = floor - round(sure * SIDE)
        cv2.line(picture, (x0, y), (x1, y), ON, 2)
        cv2.rectangle(picture, (x0, base - max(1, round(n / most * PILE))), (x1, base), (150, 150, 150), -1)
    cv2.line(picture, (LEFT, floor), (LEFT + SIDE, TOP), (190, 190, 190), 1, cv2.LINE_AA)
    for y in (floor, base):
        cv2.line(picture, (LEFT, y), (LEFT + SIDE, y), INK, 1)
    words(picture, f"{most / count.sum():.0%}", (LEFT - 8, base - PILE + 8), size=0.38, align=1)
    words(picture, "confidence", (LEFT + SIDE / 2, base + 34), size=0.42, align=0.5)
    for text, color, x in (("accuracy", OFF, LEFT), ("confidence", ON, LEFT + 110)):
        cv2.rectangle(picture, (x, TOP - 26), (x + 14, TOP - 16), color, -1)
        words(picture, text, (x + 20, TOP - 16), size=0.38)
    return picture
