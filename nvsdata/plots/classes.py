"""What a classifier makes of each class: which it takes for which, and how many it gets right."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from nvsdata.plots.drawing import FAINT, INK, OFF, ON, shortened, width_of, words

SIDE = 1_400  # pixels that a large matrix takes
CELL = 48  # most pixels of a cell
COUNTED = 30  # pixels from which a cell has room for a number
LINE = 13  # pixels that a small line of text takes
SMALL = 0.36  # size of font
LONGEST_NAME = 150  # pixels
MOST_BARS = 120
SHARES = (0.01, 0.05, 0.2, 0.5, 1.0)  # in the legend


def confusion(counts: np.ndarray, classes: Sequence[str], title: str) -> np.ndarray:
    """A confusion matrix; uint8 [H, W, 3], BGR.

    What is right is blue, what is wrong red, the darker the larger its share of the row (the shade is the root of
    the share, so that rare mistakes show). Numbers are counts, if there is room. If names would overlap, only some
    are written.

    - `counts`: [C, C], a row per true class, a column per predicted one
    - `classes`: names, C
    - `title`: drawn above
    """
    count = len(classes)
    cell = min(CELL, max(2, SIDE // count))
    every = -(-LINE // cell)
    names = [shortened(name, LONGEST_NAME, SMALL) for name in classes]
    margin = max(width_of(name, SMALL) for name in names) + 12
    left, top, side = max(margin, 44) + 12, margin + 56, cell * count
    picture = np.full((top + side + 60, max(left + side, 460) + 20, 3), 255, np.uint8)
    shares = counts / np.maximum(counts.sum(1, keepdims=True), 1)
    shades = _shade(shares, np.eye(count, dtype=bool))
    picture[top : top + side, left : left + side] = shades.repeat(cell, 0).repeat(cell, 1)
    if cell >= 8:
        picture[top : top + side + 1 : cell, left : left + side + 1] = FAINT
        picture[top : top + side + 1, left : left + side + 1 : cell] = FAINT
    for i in range(0, count, every):
        middle = i * cell + cell / 2
        words(picture, names[i], (left - 6, top + middle + 4), size=SMALL, align=1)
        _upright(picture, names[i], round(left + middle), top - 6)
    if cell >= COUNTED:
        for i, j in np.argwhere(counts):
            color = (255, 255, 255) if shares[i, j] > 0.3 else INK
            at = (left + (j + 0.5) * cell, top + (i + 0.5) * cell + 4)
            words(picture, str(counts[i, j]), at, size=0.42, color=color, align=0.5)
    words(picture, title, (12, 22), size=0.55)
    words(picture, "rows: true class, columns: predicted class", (12, 42), size=0.4)
    _legend(picture, left, top + side + 20)
    return picture


def _shade(shares: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Colors [..., 3] of shares [...], blue where `right`, else red."""
    full = np.where(right[..., None], np.array((130, 60, 10)), np.array((20, 20, 160)))
    return np.asarray(255 + (full - 255) * np.sqrt(shares)[..., None], np.uint8)


def _upright(picture: np.ndarray, text: str, x: int, bottom: int) -> None:
    """Text that is read from below, centered at x and ending at `bottom`."""
    strip = np.full((LINE + 3, width_of(text, SMALL) + 2, 3), 255, np.uint8)
    words(strip, text, (1, 12), size=SMALL)
    turned = cv2.rotate(strip, cv2.ROTATE_90_COUNTERCLOCKWISE)
    height, width = turned.shape[:2]
    place = picture[bottom - height : bottom, x - width // 2 : x - width // 2 + width]
    # names of neighbors may touch
    np.minimum(place, turned[:, : place.shape[1]], out=place)


def _legend(picture: np.ndarray, x: int, y: int) -> None:
    for row, (name, right) in enumerate((("right", True), ("wrong", False))):
        words(picture, name, (x - 6, y + 11 + row * 16), size=SMALL, align=1)
        for i, share in enumerate(SHARES):
            color = _shade(np.array(share), np.array(right)).tolist()
            start = (x + i * 44, y + row * 16)
            cv2.rectangle(picture, start, (start[0] + 42, start[1] + 13), color, -1)
            if right:
                words(picture, f"{share:.0%}", (start[0] + 21, y - 4), size=SMALL, align=0.5)


def class_bars(
    classes: Sequence[str], counts: np.ndarray, kinds: Sequence[tuple[str, np.ndarray]], title: str
) -> np.ndarray:
    """The accuracy of each class, worst first; uint8 [H, W, 3], BGR. At most 120 classes are drawn.

    - `classes`: names, C
    - `counts`: samples of each, [C]; classes without any are left out
    - `kinds`: names and accuracies [C] of one or two kinds; the first is drawn as bars, the second as strokes
    - `title`: drawn above
    """
    there = np.flatnonzero(counts)
    order = there[np.argsort(kinds[0][1][there], kind="stable")][:MOST_BARS]
    names = [shortened(classes[i], LONGEST_NAME, SMALL) for i in order]
    row = 22 if len(order) <= 40 else LINE
    left = max(width_of(name, SMALL) for name in names) + 24
    top, length = 70, 480
    picture = np.full((top + row * len(order) + 16, left + length + 110, 3), 255, np.uint8)
    bottom = top + row * len(order)
    for share in (0.0, 0.25, 0.5, 0.75, 1.0):
        x = left + round(share * length)
        cv2.line(picture, (x, top), (x, bottom), FAINT, 1)
        words(picture, f"{share:.0%}", (x, top - 6), size=SMALL, align=0.5)
    for n, i in enumerate(order):
        high, low = top + n * row + 2, top + (n + 1) * row - 2
        words(picture, names[n], (left - 8, (high + low) / 2 + 4), size=SMALL, align=1)
        cv2.rectangle(picture, (left, high), (left + round(kinds[0][1][i] * length), low), OFF, -1)
        for _, values in kinds[1:]:
            x = left + round(values[i] * length)
            cv2.line(picture, (x, high - 1), (x, low + 1), ON, 2)
        value = f"{kinds[0][1][i]:.1%} of {counts[i]}"
        words(picture, value, (left + length + 12, (high + low) / 2 + 4), size=SMALL)
    shown = f", the {len(order)} worst of {len(there)} classes" if len(order) < len(there) else ""
    words(picture, title + shown, (12, 22), size=0.5)
    for (name, _), color, x in zip(kinds, (OFF, ON), (12, 172), strict=False):
        cv2.rectangle(picture, (x, 33), (x + 14, 43), color, -1)
        words(picture, name, (x + 20, 43), size=SMALL)
    return picture
