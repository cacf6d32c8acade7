"""A figure over recordings that follow each other."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from nvsdata.plots.axes import LINES, chart, drawn, rgb
from nvsdata.plots.drawing import INK

FAR = 10  # a limit that is so many times the largest value away is only named


def timeline(
    values: Sequence[float],
    title: str,
    xlabel: str,
    size: tuple[int, int] = (900, 220),
    limits: Sequence[float] = (),
    form: str = ",.4g",
) -> np.ndarray:
    """Points of values against their number, from 1 on, uint8 [H, W, 3], BGR; NaN leaves a gap.

    - `title`, `xlabel`: drawn above the points and below the axis
    - `size`: (width, height) of the picture in pixels (default (900, 220))
    - `limits`: drawn as lines; one that is far above all values is stated in the title instead (default: none)
    - `form`: how values are written (default ",.4g")
    """
    from matplotlib.ticker import FuncFormatter, MaxNLocator

    given = np.asarray(values, float)
    largest = float(np.nanmax(np.abs(given), initial=0))
    far = [limit for limit in limits if limit > FAR * largest]
    told = "".join(f"; limit {limit:{form}}, above the chart" for limit in far)
    figure, axes = chart(size, f"{title}{told}", xlabel)
    axes.plot(np.arange(1, given.size + 1), given, ".", color=LINES[0])
    for limit in limits:
        if limit not in far:
            axes.axhline(limit, color=rgb(INK), linewidth=1, linestyle="--")
            place = axes.get_yaxis_transform()
            axes.text(1, limit, f" limit {limit:{form}}", transform=place, va="center", fontsize=8, color=rgb(INK))
    axes.set_xlim(0.5, max(given.size, 1) + 0.5)
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:{form}}"))
    return drawn(figure)
