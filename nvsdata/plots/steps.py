"""One value at each of a few settings."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from nvsdata.plots.axes import LINES, chart, drawn

SIZE = 720, 420  # pixels
MOST_WRITTEN = 12


def marked(values: Sequence[float], names: Sequence[str], title: str, xlabel: str) -> np.ndarray:
    """Shares, joined by a line, each with its number; uint8 [H, W, 3], BGR.

    The axis ends at 1 and begins at the tenth below the least value. Of more than 12 values, some are written.

    - `values`: from 0 to 1
    - `names`: what each belongs to, written below; they lie at even distances
    - `title`, `xlabel`: drawn above and below
    """
    figure, axes = chart(SIZE, title, xlabel)
    axes.plot(range(len(values)), values, color=LINES[0], marker="o", markersize=6, clip_on=False)
    written = range(0, len(values), -(-len(values) // MOST_WRITTEN))
    for i in written:
        axes.annotate(f"{values[i]:.3f}", (i, values[i]), (0, 7), textcoords="offset points", ha="center", fontsize=8)
    slanted = max(len(names[i]) for i in written) > 8
    axes.set_xticks(list(written), [names[i] for i in written], rotation=20 if slanted else 0)
    axes.set_ylim(min(int(min(values) * 10) / 10, 0.9), 1.0)
    axes.margins(x=0.06)
    # numbers of values near 1 stand above the axis's end
    axes.set_title(title, fontsize=10, loc="left", pad=14)
    return drawn(figure)
