"""What a classifier makes of each class: which it takes for which, and how many it gets right."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from nvsdata.common.errors import shown
from nvsdata.plots.axes import LINES, drawn, dress, empty, words

if TYPE_CHECKING:
    from matplotlib.axes import Axes

CELL, FEWEST, MOST = 40, 320, 1_300  # pixels of a cell, and of a whole matrix
COUNTED = 26  # pixels from which a cell has room for a number
LINE = 13  # pixels that a small line of text takes
LONGEST = 24  # letters of a name
MOST_BARS = 120
SHARES = (0.01, 0.05, 0.2, 0.5, 1.0)  # in the legend
RIGHT, WRONG = (10, 60, 130), (160, 20, 20)


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
    side = min(max(CELL * count, FEWEST), MOST)
    cell = side / count
    names = [_short(name) for name in classes]
    margin = 60 + 6 * max(map(len, names))
    figure = empty((side + margin, side + margin + 80))
    axes, legend = figure.subplots(2, 1, height_ratios=(side, 36))
    dress(axes, title, "predicted class", "true class")
    axes.grid(visible=False)
    shares = counts / np.maximum(counts.sum(1, keepdims=True), 1)
    axes.imshow(_shade(shares, np.eye(count, dtype=bool)), interpolation="nearest")
    written = range(0, count, max(round(LINE / cell), 1))
    axes.set_xticks(written, [names[i] for i in written], rotation=90)
    axes.set_yticks(written, [names[i] for i in written])
    if cell >= COUNTED:
        for i, j in np.argwhere(counts):
            color = "white" if shares[i, j] > 0.3 else "0.25"
            axes.text(j, i, str(counts[i, j]), fontsize=8, ha="center", va="center", color=color)
    _legend(legend)
    return drawn(figure)


def _shade(shares: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Colors RGB [..., 3] of shares [...], blue where `right`, else red."""
    full = np.where(right[..., None], np.array(RIGHT), np.array(WRONG))
    return np.asarray(255 + (full - 255) * np.sqrt(shares)[..., None], np.uint8)


def _legend(axes: Axes) -> None:
    axes.imshow(_shade(np.array([SHARES, SHARES]), np.array([[True], [False]])), aspect="auto")
    axes.set_xticks(range(len(SHARES)), [f"{share:.0%}" for share in SHARES], fontsize=8)
    axes.set_yticks((0, 1), ("right", "wrong"), fontsize=8)
    axes.tick_params(length=0)
    axes.set_xlabel("share of the row", fontsize=8)


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
    shown = f", the {len(order)} worst of {len(there)} classes" if len(order) < len(there) else ""
    figure = empty((760, 110 + (22 if len(order) <= 40 else LINE) * len(order)))
    axes = figure.add_subplot()
    dress(axes, title + shown, "accuracy")
    places, (name, values) = np.arange(len(order)), kinds[0]
    axes.barh(places, values[order], 0.8, color=LINES[0], label=name)
    for name, values in kinds[1:]:
        axes.vlines(values[order], places - 0.45, places + 0.45, color=LINES[1], linewidth=2, label=name)
    axes.set_yticks(places, [_short(classes[i]) for i in order])
    axes.grid(visible=False, axis="y")
    axes.set_xlim(0, 1)
    axes.set_ylim(len(order) - 0.4, -0.6)
    axes.xaxis.set_major_formatter(lambda share, _: f"{share:.0%}")
    for place, i in enumerate(order):
        text = f"{kinds[0][1][i]:.1%} of {counts[i]}"
        axes.text(1.02, place, text, fontsize=8, va="center", transform=axes.get_yaxis_transform())
    figure.legend(loc="outside lower right", ncols=len(kinds), fontsize=8, frameon=False)
    return drawn(figure)


def _short(name: str) -> str:
    name = shown(name)
    return words(name if len(name) <= LONGEST else name[: LONGEST - 2] + "..")
