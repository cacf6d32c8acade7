"""A figure over recordings that follow each other."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from nvsdata.plots.axes import LINES, chart, drawn


def timeline(values: Sequence[float], title: str, xlabel: str, size: tuple[int, int] = (900, 220)) -> np.ndarray:
    """Points of values against their number, from 1 on, uint8 [H, W, 3], BGR; NaN leaves a gap.

    - `title`, `xlabel`: drawn above the points and below the axis
    - `size`: (width, height) of the picture in pixels (default (900, 220))
    """
    figure, axes = chart(size, title, xlabel)
    given = np.asarray(values, float)
    axes.plot(np.arange(1, given.size + 1), given, ".", color=LINES[0])
    axes.set_xlim(0.5, max(given.size, 1) + 0.5)
    return drawn(figure)
