"""Charts with axes, drawn by matplotlib without a window."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from nvsdata.common.errors import shown
from nvsdata.plots.drawing import BOTH, FAINT, INK, OFF, ON

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

DPI = 100


def rgb(bgr: tuple[int, int, int]) -> tuple[float, float, float]:
    """A color of OpenCV's for matplotlib."""
    blue, green, red = bgr
    return red / 255, green / 255, blue / 255


LINES = [rgb(OFF), rgb(ON), rgb(BOTH), rgb((90, 160, 60)), rgb((40, 150, 230))]


def empty(size: tuple[int, int]) -> Figure:
    """A figure of (width, height) pixels without a window."""
    # not at import: it takes as long as all of nvsdata
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(size[0] / DPI, size[1] / DPI), dpi=DPI, layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def chart(size: tuple[int, int], title: str = "", xlabel: str = "", ylabel: str = "") -> tuple[Figure, Axes]:
    """An empty chart of (width, height) pixels."""
    figure = empty(size)
    axes = figure.add_subplot()
    dress(axes, title, xlabel, ylabel)
    return figure, axes


def words(text: str) -> str:
    """A name as matplotlib writes it: printable, and without formulas, which dollar signs would begin."""
    return shown(text).replace("$", r"\$")


def dress(axes: Axes, title: str = "", xlabel: str = "", ylabel: str = "") -> None:
    """Give axes our colors and their words."""
    axes.set_title(words(title), fontsize=10, color=rgb(INK), loc="left")
    axes.set_xlabel(words(xlabel), fontsize=9, color=rgb(INK))
    axes.set_ylabel(words(ylabel), fontsize=9, color=rgb(INK))
    axes.tick_params(labelsize=8, colors=rgb(INK))
    axes.grid(color=rgb(FAINT), linewidth=0.8)
    axes.set_axisbelow(True)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)


def drawn(figure: Figure) -> np.ndarray:
    """The figure as uint8 [H, W, 3], BGR."""
    figure.canvas.draw()
    return np.ascontiguousarray(np.asarray(figure.canvas.buffer_rgba())[..., 2::-1])  # type: ignore[attr-defined]
