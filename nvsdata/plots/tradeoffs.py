"""Two values of each of several choices, and those that no other choice surpasses in both."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from nvsdata.plots.drawing import FAINT, INK, OFF, ON, words

WIDTH, HEIGHT = 900, 560  # pixels
LEFT, RIGHT, TOP, BOTTOM = 90, 40, 60, 60  # margins around the points


def front(points: Sequence[tuple[float, float]]) -> list[int]:
    """Numbers of the points (cost, gain) for which no other costs no more and gains more, by cost."""
    best, found = -np.inf, []
    for i in sorted(range(len(points)), key=lambda i: (points[i][0], -points[i][1])):
        if points[i][1] > best:
            best = points[i][1]
            found.append(i)
    return found


def tradeoff(
    points: Sequence[tuple[float, float]], names: Sequence[str], title: str, xlabel: str, ylabel: str
) -> np.ndarray:
    """Points (cost, gain) and the front of those that none surpasses, which have names; uint8 [H, W, 3], BGR.

    - `points`: at least one; costs lie on a logarithmic axis, above 0
    - `names`: of the points
    - `title`, `xlabel`, `ylabel`: drawn above, below and beside
    """
    picture = np.full((HEIGHT, WIDTH, 3), 255, np.uint8)
    x, y = np.log(np.array([cost for cost, _ in points])), np.array([gain for _, gain in points])
    (x0, x1), (y0, y1) = (x.min() - 0.1, x.max() + 0.1), (y.min() - 0.005, y.max() + 0.005)

    def place(across: float, up: float) -> tuple[int, int]:
        column = LEFT + (WIDTH - LEFT - RIGHT) * (across - x0) / (x1 - x0)
        return round(column), round(HEIGHT - BOTTOM - (HEIGHT - TOP - BOTTOM) * (up - y0) / (y1 - y0))

    for tick in np.linspace(y0, y1, 6):
        row = place(x0, tick)[1]
        cv2.line(picture, (LEFT, row), (WIDTH - RIGHT, row), FAINT, 1)
        words(picture, f"{tick:.3f}", (LEFT - 8, row + 5), align=1)
    for tick in np.linspace(x0, x1, 6):
        words(picture, f"{np.exp(tick):.3g}", (place(tick, y0)[0], HEIGHT - BOTTOM + 22), align=0.5)
    best = front(points)
    cv2.polylines(picture, [np.array([place(x[i], y[i]) for i in best], np.int32)], False, OFF, 2, cv2.LINE_AA)
    for i in range(len(points)):
        cv2.circle(picture, place(x[i], y[i]), 4, OFF if i in best else ON, -1, cv2.LINE_AA)
    for i in best:
        column, row = place(x[i], y[i])
        words(picture, names[i], (column, row - 10), size=0.42, align=1.0 if column > WIDTH / 2 else 0.0)
    words(picture, title, (LEFT, 26), size=0.55)
    words(picture, xlabel, (WIDTH / 2, HEIGHT - 10), align=0.5)
    words(picture, ylabel, (LEFT, 48), size=0.42)
    cv2.line(picture, (LEFT, HEIGHT - BOTTOM), (WIDTH - RIGHT, HEIGHT - BOTTOM), INK, 1)
    return picture
