"""Charts of numbers: lines, points at a few settings, timelines, and trade-offs between two values."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from nvsdata.plots.axes import CURVES, DPI, LINES, new_chart, rendered, rgb
from nvsdata.plots.drawing import INK

if TYPE_CHECKING:
    from matplotlib.axes import Axes

POINTS_SIZE = 720, 420  # pixels
MOST_WRITTEN = 12  # values that a chart of points states as numbers
FAR = 10  # a limit beyond this many times the largest value is named in the title, not drawn
TRADEOFF_SIZE = 900, 560  # pixels
TICKS = (0, 0.3, 0.5, 0.7, 0.8, 0.85, 0.9, 0.92, 0.94, 0.95, 0.96, 0.97, 0.98, 0.985, 0.99, 0.995, 0.998, 0.999, 1)
LEAST = 0.0005  # added to distances from 1, so that their logarithms are finite
# offsets of a name from its point, in typographic points (1/72 inch), in order of preference
SIDES = (-1, 1), (1, -1), (1, 1), (-1, -1), (-0.2, 1), (0.2, -1)
PLACES = [(dx * far, dy * far) for far in (8, 18, 30, 44, 60, 80, 105, 130) for dx, dy in SIDES]


def curves(
    lines: Sequence[tuple[str, Sequence[float]]],
    title: str,
    xlabel: str,
    size: tuple[int, int] = (720, 420),
    highest: float = 1.0,
    ends: tuple[float, float] | None = None,
) -> np.ndarray:
    """Draw lines of values, which are evenly spaced along the horizontal axis.

    Args:
        lines: Name and values of each line.
        title: Text above the chart.
        xlabel: Text below the axis.
        size: (width, height) of the image in pixels (default (720, 420)).
        highest: Upper end of the vertical axis, which begins at 0 (default 1).
        ends: Positions of the first and the last value of the longest line; the others are evenly spaced between
            them (default: 1, 2, 3 and so on).

    Returns:
        uint8 [height, width, 3], BGR.

    Example:
        >>> curves([("loss", [0.9, 0.5, 0.3])], "training", "epoch").shape
        (420, 720, 3)
    """
    from matplotlib.ticker import MaxNLocator

    figure, axes = new_chart(size, title, xlabel)
    longest = max(max(len(values) for _, values in lines), 2)
    first, last = (1, longest) if ends is None else ends
    places = np.linspace(first, last, longest)
    for i, (name, values) in enumerate(lines):
        alone = "o" if len(values) == 1 else None
        axes.plot(places[: len(values)], values, color=CURVES[i % len(CURVES)], label=name, marker=alone)
    axes.set_xlim(first, last)
    axes.set_ylim(0, highest * 1.02)
    if ends is None:
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    figure.legend(loc="outside upper right", ncols=len(lines), fontsize=8, frameon=False)
    return rendered(figure)


def score_curve(scores: np.ndarray) -> np.ndarray:
    """Draw the score of each trial of a search, and the best score so far.

    Args:
        scores: Scores of the trials, [N]. Infinite ones are drawn as the highest finite one.

    Returns:
        uint8 [420, 720, 3], BGR.
    """
    highest = float(scores[np.isfinite(scores)].max())
    each = np.minimum(scores, highest)
    lines = [("each trial", each.tolist()), ("best so far", np.minimum.accumulate(each).tolist())]
    return curves(lines, "weighted score (lower is closer)", "trial", highest=highest)


def points_chart(
    values: Sequence[float],
    names: Sequence[str],
    title: str,
    xlabel: str,
    intervals: Sequence[tuple[float, float]] = (),
) -> np.ndarray:
    """Draw a fraction at each of a few settings, as points that are joined by a line and labeled with their values.

    The vertical axis ends at 1 and begins at the tenth below the smallest value or interval. If there are more than 12
    values, only some points are labeled.

    Args:
        values: The fractions, such as accuracies, from 0 to 1.
        names: Name of each setting, written below the axis. The settings are evenly spaced.
        title: Text above the chart.
        xlabel: Text below the axis.
        intervals: Confidence interval of each value, (low, high), drawn as a vertical line (default: none).

    Returns:
        uint8 [420, 720, 3], BGR.

    Example:
        >>> points_chart([0.81, 0.9], ["10 ms", "30 ms"], "accuracy", "window").shape
        (420, 720, 3)
    """
    figure, axes = new_chart(POINTS_SIZE, title, xlabel)
    for i, (low, high) in enumerate(intervals):
        axes.vlines(i, low, high, color=LINES[0], linewidth=2, alpha=0.4)
    axes.plot(range(len(values)), values, color=LINES[0], marker="o", markersize=6, clip_on=False)
    written = range(0, len(values), -(-len(values) // MOST_WRITTEN))
    for i in written:
        axes.annotate(f"{values[i]:.3f}", (i, values[i]), (0, 7), textcoords="offset points", ha="center", fontsize=8)
    slanted = max(len(names[i]) for i in written) > 8
    axes.set_xticks(list(written), [names[i] for i in written], rotation=20 if slanted else 0)
    lowest = min([*values, *(low for low, _ in intervals)])
    axes.set_ylim(min(int(lowest * 10) / 10, 0.9), 1.0)
    axes.margins(x=0.06)
    # leaves space for labels of values near 1, which are above the end of the axis
    axes.set_title(title, fontsize=10, loc="left", pad=14)
    return rendered(figure)


def timeline(
    values: Sequence[float],
    title: str,
    xlabel: str,
    size: tuple[int, int] = (900, 220),
    limits: Sequence[float] = (),
    form: str = ",.4g",
) -> np.ndarray:
    """Draw one value per recording, as points against the number of the recording, which counts from 1.

    Args:
        values: The values. NaN leaves a gap.
        title: Text above the chart.
        xlabel: Text below the axis.
        size: (width, height) of the image in pixels (default (900, 220)).
        limits: Values that are drawn as dashed lines. A limit far above all values is stated in the title instead
            (default: none).
        form: Format of numbers (default ",.4g").

    Returns:
        uint8 [height, width, 3], BGR.
    """
    from matplotlib.ticker import FuncFormatter, MaxNLocator

    given = np.asarray(values, float)
    largest = float(np.nanmax(np.abs(given), initial=0))
    far = [limit for limit in limits if limit > FAR * largest]
    above = "".join(f"; limit {limit:{form}}, above the chart" for limit in far)
    figure, axes = new_chart(size, f"{title}{above}", xlabel)
    axes.plot(np.arange(1, given.size + 1), given, ".", color=LINES[0])
    for limit in limits:
        if limit not in far:
            axes.axhline(limit, color=rgb(INK), linewidth=1, linestyle="--")
            place = axes.get_yaxis_transform()
            axes.text(1, limit, f" limit {limit:{form}}", transform=place, va="center", fontsize=8, color=rgb(INK))
    axes.set_xlim(0.5, max(given.size, 1) + 0.5)
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:{form}}"))
    return rendered(figure)


def pareto_front(points: Sequence[tuple[float, float]]) -> list[int]:
    """Return the indices of the points on the Pareto front, in order of cost.

    A point is on the front unless another one costs no more and gains at least as much. Of equal points, the first is
    on the front.

    Args:
        points: (cost, gain) of each point.

    Example:
        >>> pareto_front([(1, 0.5), (2, 0.4), (3, 0.9)])
        [0, 2]
    """
    best, found = -np.inf, []
    for i in sorted(range(len(points)), key=lambda i: (points[i][0], -points[i][1])):
        if points[i][1] > best:
            best = points[i][1]
            found.append(i)
    return found


def tradeoff(
    points: Sequence[tuple[float, float]], names: Sequence[str], title: str, xlabel: str, ylabel: str
) -> np.ndarray:
    """Draw points of cost and gain; those on the Pareto front are joined by a line and named.

    Args:
        points: (cost, gain) of each point; there is at least one. Costs are above 0, on a logarithmic axis. Gains, such
            as accuracies, are at most 1, and the axis is logarithmic in their distance from 1.
        names: Name of each point.
        title: Text above the chart.
        xlabel: Text below the axis of costs.
        ylabel: Text next to the axis of gains.

    Returns:
        uint8 [560, 900, 3], BGR.

    Example:
        >>> tradeoff([(1, 0.5), (2, 0.9)], ["small", "large"], "networks", "ms", "accuracy").shape
        (560, 900, 3)
    """
    from matplotlib.ticker import LogLocator, NullFormatter

    figure, axes = new_chart(TRADEOFF_SIZE, title, xlabel, ylabel)
    cost, gain = np.array(points, float).T
    best = pareto_front(points)
    axes.set_xscale("log")
    axes.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    axes.xaxis.set_major_formatter("{x:g}")
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.set_yscale("function", functions=(_nearness, _gain))
    axes.set_yticks(TICKS)
    axes.scatter(cost, gain, color=[LINES[0] if i in best else LINES[1] for i in range(len(points))], s=22, zorder=3)
    axes.plot(cost[best], gain[best], color=LINES[0])
    axes.margins(0.12)
    low, high = _nearness(gain.min()), _nearness(gain.max())
    axes.set_ylim(_gain(low - 0.08), _gain(high + 0.12))
    figure.canvas.draw()
    _write_names(axes, [(float(cost[i]), float(gain[i]), names[i]) for i in best], points)
    return rendered(figure)


def _nearness(gain: Any) -> Any:
    """Return the position of a gain on its axis: minus the decimal logarithm of its distance from 1."""
    return -np.log10(1 + LEAST - np.clip(gain, 0, 1))


def _gain(nearness: Any) -> Any:
    """Invert `_nearness`."""
    return 1 + LEAST - 10.0**-nearness


def _write_names(axes: Axes, named: Sequence[tuple[float, float, str]], points: Sequence[tuple[float, float]]) -> None:
    """Write each name at the first position around its point where it covers no other name or point."""
    from matplotlib.transforms import Bbox

    taken = [Bbox([[x - 3, y - 3], [x + 3, y + 3]]) for x, y in axes.transData.transform(points)]
    for x, y, name in named:
        text = axes.text(x, y, name, fontsize=8)
        size, at = np.array(text.get_window_extent().size), axes.transData.transform((x, y))
        text.remove()
        for place in PLACES:
            corner = at + np.array(place) * DPI / 72 - (size * (1, 0) if place[0] < 0 else 0)
            box = Bbox([corner, corner + size]).padded(2)
            inside = axes.bbox.containsx(box.x0) and axes.bbox.containsx(box.x1) and axes.bbox.containsy(box.y0)
            if inside and not any(box.overlaps(other) for other in taken):
                break
        taken.append(box)
        leader = {"arrowstyle": "-", "color": "0.6", "linewidth": 0.6, "shrinkA": 0}
        side = "right" if place[0] < 0 else "left"
        written = axes.annotate(name, (x, y), place, textcoords="offset points", ha=side, fontsize=8, arrowprops=leader)
        # the layout must not move the axes after the names have been placed
        written.set_in_layout(False)
