"""Whether a classifier is as often right as it says."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from nvsdata.plots.axes import LINES, drawn, dress, empty

Bins = tuple[np.ndarray, np.ndarray, np.ndarray, float]
"""Of each bin: count, mean confidence, accuracy [bins]; and the expected calibration error."""

SIZE = 420, 520  # pixels of a panel


def reliability(kinds: Sequence[tuple[str, Bins]]) -> np.ndarray:
    """Reliability diagrams side by side; uint8 [H, W, 3], BGR.

    Blue bars are the accuracy of each bin, from left to right by confidence; the red stroke across is its mean
    confidence, where the bar would end if that were true. Below: the share of predictions in each bin.

    - `kinds`: name of each, and its bins, such as `metrics.calibration` gives
    """
    return np.concatenate([_panel(name, bins) for name, bins in kinds], 1)


def _panel(name: str, bins: Bins) -> np.ndarray:
    count, confidence, accuracy, error = bins
    figure = empty(SIZE)
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=(4, 1))
    dress(above, f"{name}: expected calibration error {error:.3f}", ylabel="accuracy")
    dress(below, xlabel="confidence", ylabel="share")
    edges, some = np.linspace(0, 1, len(count) + 1), np.asarray(count) > 0
    left, wide = edges[:-1][some], 1 / len(count)
    above.bar(left, accuracy[some], 0.92 * wide, align="edge", color=LINES[0], label="accuracy")
    above.hlines(confidence[some], left, left + 0.92 * wide, color=LINES[1], linewidth=2, label="confidence")
    above.plot((0, 1), (0, 1), color="0.75", linewidth=1)
    below.bar(left, count[some] / max(count.sum(), 1), 0.92 * wide, align="edge", color="0.6")
    above.set_xlim(0, 1)
    above.set_ylim(0, 1)
    figure.legend(loc="outside upper right", ncols=2, fontsize=8, frameon=False)
    return drawn(figure)
