"""Values against steps."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from nvsdata.plots.axes import LINES, chart, drawn


def curves(
    lines: Sequence[tuple[str, Sequence[float]]],
    title: str,
    xlabel: str,
    size: tuple[int, int] = (720, 420),
    highest: float = 1.0,
    ends: tuple[float, float] | None = None,
) -> np.ndarray:
    """Lines of values against their number, uint8 [H, W, 3], BGR.

    - `lines`: names and values of each line
    - `title`, `xlabel`: drawn above the lines and below the axis
    - `size`: (width, height) of the picture in pixels (default (720, 420))
    - `highest`: the largest value that fits, the least is 0 (default 1)
    - `ends`: what the first and the last value are at, evenly in between (default: 1, 2, 3 and so on)
    """
    from matplotlib.ticker import MaxNLocator

    figure, axes = chart(size, title, xlabel)
    longest = max(max(len(values) for _, values in lines), 2)
    first, last = (1, longest) if ends is None else ends
    places = np.linspace(first, last, longest)
    for i, (name, values) in enumerate(lines):
        alone = "o" if len(values) == 1 else None
        axes.plot(places[: len(values)], values, color=LINES[i % len(LINES)], label=name, marker=alone)
    axes.set_xlim(first, last)
    axes.set_ylim(0, highest * 1.02)
    if ends is None:
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    figure.legend(loc="outside upper right", ncols=len(lines), fontsize=8, frameon=False)
    return drawn(figure)
