"""Two values of each of several choices, and those that no other choice surpasses in both."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from nvsdata.plots.axes import DPI, LINES, chart, drawn

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SIZE = 900, 560  # pixels
TICKS = (0, 0.3, 0.5, 0.7, 0.8, 0.85, 0.9, 0.92, 0.94, 0.95, 0.96, 0.97, 0.98, 0.985, 0.99, 0.995, 0.998, 0.999, 1)
LEAST = 0.0005  # lack of 1 that counts as none
# where a name may stand, in points from what it names, the best first
SIDES = (-1, 1), (1, -1), (1, 1), (-1, -1), (-0.2, 1), (0.2, -1)
PLACES = [(dx * far, dy * far) for far in (8, 18, 30, 44, 60, 80, 105, 130) for dx, dy in SIDES]


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

    - `points`: at least one; costs, above 0, lie on a logarithmic axis, and so does what gains, such as accuracies,
      lack of 1
    - `names`: of the points
    - `title`, `xlabel`, `ylabel`: drawn above, below and beside
    """
    from matplotlib.ticker import LogLocator, NullFormatter

    figure, axes = chart(SIZE, title, xlabel, ylabel)
    cost, gain = np.array(points, float).T
    best = front(points)
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
    _name(axes, [(float(cost[i]), float(gain[i]), names[i]) for i in best], points)
    return drawn(figure)


def _nearness(gain: Any) -> Any:
    """How near to 1, in powers of ten."""
    return -np.log10(1 + LEAST - np.clip(gain, 0, 1))


def _gain(nearness: Any) -> Any:
    """The gain that is so near to 1."""
    return 1 + LEAST - 10.0**-nearness


def _name(axes: Axes, named: Sequence[tuple[float, float, str]], points: Sequence[tuple[float, float]]) -> None:
    """Write names beside points, each at the first place around its point where it covers no other name or point."""
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
        # the axes stay where they were measured
        written.set_in_layout(False)
