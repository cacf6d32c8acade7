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
    """Convert a BGR color from 0 to 255, as in OpenCV, to an RGB color from 0 to 1, as in matplotlib."""
    blue, green, red = bgr
    return red / 255, green / 255, blue / 255


# colors of learning curves and other lines by name: none is that of ON or OFF
CURVES = [rgb((90, 160, 60)), rgb((40, 150, 230)), rgb((120, 110, 0)), rgb((50, 80, 140)), rgb((110, 110, 110))]
# colors of the marks of a chart, in order
LINES = [rgb(OFF), rgb(ON), rgb(BOTH), rgb((90, 160, 60)), rgb((40, 150, 230))]


def new_figure(size: tuple[int, int]) -> Figure:
    """Return an empty figure of (width, height) pixels without a window."""
    # imported here, because matplotlib takes as long as nvsdata to import
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(size[0] / DPI, size[1] / DPI), dpi=DPI, layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def new_chart(size: tuple[int, int], title: str = "", xlabel: str = "", ylabel: str = "") -> tuple[Figure, Axes]:
    """Return an empty chart of (width, height) pixels."""
    figure = new_figure(size)
    axes = figure.add_subplot()
    style_axes(axes, title, xlabel, ylabel)
    return figure, axes


def escaped(text: str) -> str:
    """Escape a text for matplotlib: control characters, and dollar signs, which would begin a formula."""
    return shown(text).replace("$", r"\$")


def style_axes(axes: Axes, title: str = "", xlabel: str = "", ylabel: str = "") -> None:
    """Set the title, the labels and the colors of axes."""
    axes.set_title(escaped(title), fontsize=10, color=rgb(INK), loc="left")
    axes.set_xlabel(escaped(xlabel), fontsize=9, color=rgb(INK))
    axes.set_ylabel(escaped(ylabel), fontsize=9, color=rgb(INK))
    axes.tick_params(labelsize=8, colors=rgb(INK))
    axes.grid(color=rgb(FAINT), linewidth=0.8)
    axes.set_axisbelow(True)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)


def rendered(figure: Figure) -> np.ndarray:
    """Draw a figure into an image, uint8 [H, W, 3], BGR."""
    figure.canvas.draw()
    return np.ascontiguousarray(np.asarray(figure.canvas.buffer_rgba())[..., 2::-1])  # type: ignore[attr-defined]
