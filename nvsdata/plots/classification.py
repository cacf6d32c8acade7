"""Charts of a classifier's results: confusion matrix, accuracy of each class, calibration."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from nvsdata.common.errors import shown
from nvsdata.plots.axes import LINES, escaped, new_figure, rendered, style_axes

if TYPE_CHECKING:
    from matplotlib.axes import Axes

CELL, FEWEST, MOST = 40, 320, 1_300  # pixels: side of a cell, smallest and largest side of a matrix
COUNTED = 26  # pixels; smallest side of a cell that a number fits into
LINE = 13  # pixels; height of a line of small text
LONGEST = 24  # characters of a name; longer names are shortened
MOST_BARS = 120
FRACTIONS = (0.01, 0.05, 0.2, 0.5, 1.0)  # fractions in the legend of a confusion matrix
RIGHT, WRONG = (10, 60, 130), (160, 20, 20)
PANEL_SIZE = 420, 520  # pixels of a reliability diagram

Bins = tuple[np.ndarray, np.ndarray, np.ndarray, float]
"""Count, mean confidence and accuracy of each bin, each [bins]; and the expected calibration error."""


def confusion(counts: np.ndarray, classes: Sequence[str], title: str) -> np.ndarray:
    """Draw a confusion matrix.

    Right predictions are blue and wrong ones red; cells with a larger fraction of their row are darker. (The shade is
    the square root of the fraction, so that rare errors are visible.) Counts are written if they fit. If names would
    overlap, only some are written.

    Args:
        counts: int [C, C], a row per true class, a column per predicted class, as `metrics.confusion_matrix` returns.
        classes: Names of the C classes.
        title: Text above the matrix.

    Returns:
        uint8 [H, W, 3], BGR.

    Example:
        >>> confusion(np.array([[8, 2], [0, 5]]), ["cat", "dog"], "test split").ndim
        3
    """
    count = len(classes)
    side = min(max(CELL * count, FEWEST), MOST)
    cell = side / count
    names = [_short(name) for name in classes]
    margin = 60 + 6 * max(map(len, names))
    figure = new_figure((side + margin, side + margin + 80))
    axes, legend = figure.subplots(2, 1, height_ratios=(side, 36))
    style_axes(axes, title, "predicted class", "true class")
    axes.grid(visible=False)
    fractions = counts / np.maximum(counts.sum(1, keepdims=True), 1)
    axes.imshow(_shade(fractions, np.eye(count, dtype=bool)), interpolation="nearest")
    written = range(0, count, max(round(LINE / cell), 1))
    axes.set_xticks(written, [names[i] for i in written], rotation=90)
    axes.set_yticks(written, [names[i] for i in written])
    if cell >= COUNTED:
        for i, j in np.argwhere(counts):
            color = "white" if fractions[i, j] > 0.3 else "0.25"
            axes.text(j, i, str(counts[i, j]), fontsize=8, ha="center", va="center", color=color)
    _legend(legend)
    return rendered(figure)


def _shade(fractions: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Return RGB colors [..., 3] for fractions [...], blue where `right` is true, else red."""
    full = np.where(right[..., None], np.array(RIGHT), np.array(WRONG))
    return np.asarray(255 + (full - 255) * np.sqrt(fractions)[..., None], np.uint8)


def _legend(axes: Axes) -> None:
    axes.imshow(_shade(np.array([FRACTIONS, FRACTIONS]), np.array([[True], [False]])), aspect="auto")
    axes.set_xticks(range(len(FRACTIONS)), [f"{fraction:.0%}" for fraction in FRACTIONS], fontsize=8)
    axes.set_yticks((0, 1), ("right", "wrong"), fontsize=8)
    axes.tick_params(length=0)
    axes.set_xlabel("fraction of the row", fontsize=8)


def class_bars(
    classes: Sequence[str], counts: np.ndarray, kinds: Sequence[tuple[str, np.ndarray]], title: str
) -> np.ndarray:
    """Draw the accuracy of each class, the worst first. At most 120 classes are drawn.

    Args:
        classes: Names of the C classes.
        counts: Number of samples of each class, [C]. Classes without samples are left out.
        kinds: Name and accuracies [C] of one or two kinds of accuracy, such as single-window accuracy and
            voting accuracy. The first is drawn as blue bars, the second as red strokes.
        title: Text above the chart.

    Returns:
        uint8 [H, W, 3], BGR.

    Example:
        >>> class_bars(["cat", "dog"], np.array([10, 5]), [("accuracy", np.array([0.8, 1.0]))], "test split").ndim
        3
    """
    there = np.flatnonzero(counts)
    order = there[np.argsort(kinds[0][1][there], kind="stable")][:MOST_BARS]
    cut = f", the {len(order)} worst of {len(there)} classes" if len(order) < len(there) else ""
    figure = new_figure((760, 110 + (22 if len(order) <= 40 else LINE) * len(order)))
    axes = figure.add_subplot()
    style_axes(axes, title + cut, "accuracy")
    places, (name, values) = np.arange(len(order)), kinds[0]
    axes.barh(places, values[order], 0.8, color=LINES[0], label=name)
    for name, values in kinds[1:]:
        axes.vlines(values[order], places - 0.45, places + 0.45, color=LINES[1], linewidth=2, label=name)
    axes.set_yticks(places, [_short(classes[i]) for i in order])
    axes.grid(visible=False, axis="y")
    axes.set_xlim(0, 1)
    axes.set_ylim(len(order) - 0.4, -0.6)
    axes.xaxis.set_major_formatter(lambda fraction, _: f"{fraction:.0%}")
    for place, i in enumerate(order):
        text = f"{kinds[0][1][i]:.1%} of {counts[i]}"
        axes.text(1.02, place, text, fontsize=8, va="center", transform=axes.get_yaxis_transform())
    figure.legend(loc="outside lower right", ncols=len(kinds), fontsize=8, frameon=False)
    return rendered(figure)


def _short(name: str) -> str:
    name = shown(name)
    return escaped(name if len(name) <= LONGEST else name[: LONGEST - 2] + "..")


def reliability(kinds: Sequence[tuple[str, Bins]]) -> np.ndarray:
    """Draw reliability diagrams side by side: accuracy against confidence (Guo et al. 2017).

    A blue bar is the accuracy of a bin of predictions; bins are ordered by confidence from left to right. The red
    stroke is the mean confidence of the bin. A calibrated classifier has its strokes at the ends of the bars. The chart
    below shows the fraction of predictions in each bin.

    Args:
        kinds: Name and bins of each diagram; `metrics.calibration` returns such bins.

    Returns:
        uint8 [520, 420 * kinds, 3], BGR.

    Example:
        >>> from nvsdata import metrics
        >>> reliability([("single windows", metrics.calibration([0.9, 0.6, 0.8], [1, 0, 1]))]).shape
        (520, 420, 3)
    """
    return np.concatenate([_panel(name, bins) for name, bins in kinds], 1)


def _panel(name: str, bins: Bins) -> np.ndarray:
    count, confidence, accuracy, error = bins
    figure = new_figure(PANEL_SIZE)
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=(4, 1))
    style_axes(above, f"{name}: expected calibration error {error:.3f}", ylabel="accuracy")
    style_axes(below, xlabel="confidence", ylabel="fraction")
    edges, some = np.linspace(0, 1, len(count) + 1), np.asarray(count) > 0
    left, wide = edges[:-1][some], 1 / len(count)
    above.bar(left, accuracy[some], 0.92 * wide, align="edge", color=LINES[0], label="accuracy")
    above.hlines(confidence[some], left, left + 0.92 * wide, color=LINES[1], linewidth=2, label="confidence")
    above.plot((0, 1), (0, 1), color="0.75", linewidth=1)
    below.bar(left, count[some] / max(count.sum(), 1), 0.92 * wide, align="edge", color="0.6")
    above.set_xlim(0, 1)
    above.set_ylim(0, 1)
    figure.legend(loc="outside upper right", ncols=2, fontsize=8, frameon=False)
    return rendered(figure)
