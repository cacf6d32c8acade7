"""Figures of events, graphs and tensors by matplotlib, for notebooks and scripts."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
import torch

from nvsdata.data.events import Events
from nvsdata.data.graph import Graph
from nvsdata.data.recording import Recording, as_events, wrong_type
from nvsdata.plots.axes import LINES, escaped, new_figure, rendered, style_axes
from nvsdata.plots.drawing import event_image, middle

if TYPE_CHECKING:
    from matplotlib.axes import Axes

MOST_POINTS = 50_000  # points that are drawn of a cloud
BINS = 200  # bins of the rate over time
SHOWN = 30_000  # µs of events in an image of ON and OFF
CLIPPED = 99.5  # percentile of values other than 0 where a color scale ends
OFF, ON = LINES[:2]
SMALL_LEGEND: dict[str, Any] = {"loc": "lower right", "fontsize": 7, "handlelength": 0.8, "framealpha": 0.8}


def plot(
    thing: Any, kind: str | None = None, ax: Axes | None = None, *, titles: Sequence[str] = (), label: str = ""
) -> Axes:
    """Draw events, a graph or a tensor with matplotlib.

    A graph is drawn with its edges, and its nodes in the color of their polarity. The last two axes of a tensor are an
    image; the images of all other axes are laid out side by side. NaN has no color. The color scale ends at the 99.5th
    percentile of the values other than 0, so that single hot pixels don't hide all others.

    Args:
        thing: `Events`, a `Recording` (which is decoded), a `Graph`, or a tensor or array [..., H, W].
        kind: Type of the figure of events; None for graphs and tensors.

            - "frame" (default): pixels with ON events are red, with OFF events blue, with both purple; of events
              that last longer than 30 ms, the 30 ms at the midpoint
            - "cloud": space and time in three dimensions; at most 50,000 events are drawn
            - "rate": events per second over time, by polarity
            - "polarity": number of ON minus number of OFF events per pixel
            - "histogram": distribution of the number of events per pixel
        ax: Axes to draw into, three-dimensional ones for a cloud (default: those of a new figure of
            `matplotlib.pyplot`).
        titles: Title of each image of a tensor (default: none).
        label: Quantity and unit of a tensor's values, written at the color bar (default: none).

    Returns:
        The axes.

    Raises:
        TypeError: If `thing` is anything else.
        ValueError: If the kind is unknown, or the number of titles isn't that of a tensor's images.

    Example:
        >>> from matplotlib.figure import Figure
        >>> events = Events([0, 10], [0, 3], [1, 1], [1, 0])
        >>> plot(events, "rate", ax=Figure().add_subplot()).get_xlabel()
        'time (ms)'
    """
    if isinstance(thing, Events | Recording):
        name = kind or "frame"
        if name not in KINDS:
            raise ValueError(f"kind must be one of {', '.join(map(repr, KINDS))}, not {kind!r}")
        draw: Callable[..., None] = KINDS[name]
        thing = as_events(thing)
    elif kind is not None:
        raise ValueError(f"kind is for events, not for {type(thing).__name__}")
    elif isinstance(thing, Graph):
        draw = _graph
    elif isinstance(thing, torch.Tensor | np.ndarray) and thing.ndim >= 2:
        draw = _tensor
    else:
        raise wrong_type("thing", "events, a graph or a tensor of at least two axes", thing)
    images = int(np.prod(thing.shape[:-2])) if draw is _tensor else 0
    if len(titles) not in (0, images):
        raise ValueError(f"titles must have one title for each of {images} images, not {len(titles)}")
    axes = _axes("3d" if draw is _cloud else None) if ax is None else ax
    if draw is _tensor:
        _tensor(axes, thing, titles, label)
    else:
        draw(axes, thing)
    return axes


def png(events: Events) -> bytes:
    """Draw events for a notebook: the 30 ms at the midpoint, and the rate over time. Return a PNG file."""
    figure = new_figure((900, 330))
    frame, rate = figure.subplots(1, 2, width_ratios=(1, 1.4))
    _frame(frame, events)
    _rate(rate, events)
    return cv2.imencode(".png", rendered(figure))[1].tobytes()


def _axes(projection: str | None) -> Axes:
    from matplotlib import pyplot

    axes: Axes = pyplot.figure(layout="constrained").add_subplot(projection=projection)
    return axes


def _about(events: Events) -> str:
    return f"{len(events):,} events, {events.duration / 1e3:,.1f} ms"


def _pixels(axes: Axes, title: str, size: tuple[int, int]) -> None:
    """Set up axes of a sensor's pixels, with the origin at the top left."""
    style_axes(axes, title, "x (px)", "y (px)")
    axes.grid(visible=False)
    axes.set_xlim(-0.5, size[0] - 0.5)
    axes.set_ylim(size[1] - 0.5, -0.5)
    axes.set_aspect("equal")


def _frame(axes: Axes, events: Events) -> None:
    from matplotlib.patches import Patch

    title = _about(events)
    if events.duration > SHOWN:
        begin = (events.start + events.end) // 2 - SHOWN // 2 - events.start
        events = middle(events, SHOWN)
        title = f"{len(events):,} events, {begin / 1e3:,.0f} to {(begin + SHOWN) / 1e3:,.0f} ms"
    axes.imshow(event_image(events)[..., ::-1], interpolation="nearest")
    _pixels(axes, title, events.sensor_size)
    colors = {"ON": ON, "OFF": OFF, "both": LINES[2]}
    axes.legend(handles=[Patch(color=color, label=name) for name, color in colors.items()], **SMALL_LEGEND)


def _polarity(axes: Axes, events: Events) -> None:
    summed = _per_pixel(events, 2.0 * events.p - 1)
    most = max(_highest(summed), 1)
    image = axes.imshow(summed, "RdBu_r", vmin=-most, vmax=most, interpolation="nearest")
    axes.figure.colorbar(image, ax=axes, label="ON minus OFF events per pixel", shrink=0.8, extend="both")
    _pixels(axes, _about(events), events.sensor_size)


def _rate(axes: Axes, events: Events) -> None:
    span = max(events.end - events.start, 1)
    for polarity, name in ((1, "ON"), (0, "OFF")):
        t = events.t[events.p == polarity] - events.start
        counts, edges = np.histogram(t, BINS, (0, span))
        axes.stairs(counts / (span / BINS / 1e6), edges / 1e3, color=(OFF, ON)[polarity], label=name)
    style_axes(axes, _about(events), "time (ms)", "events/s")
    axes.set_ylim(bottom=0)
    axes.legend(fontsize=8, frameon=False)


def _per_pixel(events: Events, weights: np.ndarray | None = None) -> np.ndarray:
    """Return each pixel's number of events, or the sum of their weights, [H, W]."""
    width, height = events.sensor_size
    place = events.y.astype(np.int64) * width + events.x
    return np.bincount(place, weights, width * height).reshape(height, width)


def _histogram(axes: Axes, events: Events) -> None:
    counts = _per_pixel(events)
    edges = np.unique(np.geomspace(1, max(counts.max(), 1) + 1, 40).round())
    axes.hist(counts[counts > 0], edges.tolist(), color=OFF)
    axes.set_xscale("log")
    if len(events):
        axes.set_yscale("log", nonpositive="clip")
    title = f"{_about(events)}; {np.mean(counts == 0):.0%} of the pixels have no events"
    style_axes(axes, title, "events per pixel", "number of pixels")


def _cloud(axes: Axes, events: Events) -> None:
    some = events[np.linspace(0, len(events) - 1, min(len(events), MOST_POINTS)).astype(np.int64)]
    colors = np.array([OFF, ON])[some.p]
    space: Any = axes
    space.scatter((some.t - events.start) / 1e3, some.x, some.y, c=colors, s=1, linewidths=0)
    width, height = events.sensor_size
    axes.set_title(_about(events), fontsize=10, loc="left")
    space.set(xlabel="time (ms)", ylabel="x (px)", zlabel="y (px)", ylim=(-0.5, width - 0.5), zlim=(height - 0.5, -0.5))
    axes.tick_params(labelsize=8)
    space.set_box_aspect((1.6, 1, height / width))
    _polarity_legend(axes)


def _graph(axes: Axes, graph: Graph) -> None:
    from matplotlib.collections import LineCollection

    pos = graph.pos.numpy(force=True)
    colors = np.array([OFF, ON])[(graph.x[:, 0].numpy(force=True) > 0).astype(int)]
    axes.scatter(pos[:, 0], pos[:, 1], c=colors, s=8, zorder=2)
    # above the nodes, which would hide short edges
    ends = pos[graph.edge_index.numpy(force=True).T]
    axes.add_collection(LineCollection(ends, colors="0.3", linewidths=0.4, alpha=0.7, zorder=3))
    size = graph.sensor_size or tuple((pos.max(0, initial=0) + 1).tolist())
    _pixels(axes, f"{graph.num_nodes:,} nodes, {graph.num_edges:,} edges", size)
    _polarity_legend(axes)


def _polarity_legend(axes: Axes) -> None:
    """Name the colors of points by polarity."""
    for color, name in ((ON, "ON"), (OFF, "OFF")):
        axes.plot([], [], "o", color=color, markersize=4, label=name)
    axes.legend(**SMALL_LEGEND)


def _highest(values: np.ndarray) -> float:
    """Return the largest absolute value, without the highest 0.5% of those other than 0."""
    sizes = abs(values[np.isfinite(values) & (values != 0)])
    return float(np.percentile(sizes, CLIPPED, method="higher")) if sizes.size else 0.0


def _tensor(axes: Axes, tensor: torch.Tensor | np.ndarray, titles: Sequence[str], label: str) -> None:
    from matplotlib.patches import Rectangle

    values = tensor.numpy(force=True) if isinstance(tensor, torch.Tensor) else tensor
    images = values.reshape(-1, *values.shape[-2:]).astype(np.float64)
    count, height, width = images.shape
    columns = max(1, min(count, round(np.sqrt(count * height / width * 1.5))))
    rows = max(1, -(-count // columns))
    # a gap of one pixel separates images; titles are written into higher gaps
    gap = 1 + round(0.15 * height) if titles else 1
    sheet = np.full((rows * (height + gap) - gap, columns * (width + 1) - 1), np.nan)
    for n, image in enumerate(images):
        top, left = n // columns * (height + gap), n % columns * (width + 1)
        sheet[top : top + height, left : left + width] = image
        axes.add_patch(Rectangle((left - 0.5, top - 0.5), width, height, fill=False, color="0.8", linewidth=0.6))
        if titles:
            axes.text(left, top - 0.5, escaped(titles[n]), fontsize=8, va="bottom")
    known = sheet[np.isfinite(sheet)]
    low, most = known.min(initial=np.inf), _highest(known)
    signed = low < 0
    bottom = -most if signed else min(low, most)
    shown = axes.imshow(sheet, "RdBu_r" if signed else "viridis", vmin=bottom, vmax=most, interpolation="nearest")
    clipped = known.max(initial=-np.inf) > most, signed and low < -most
    extend = {(True, True): "both", (True, False): "max", (False, True): "min"}.get(clipped, "neither")
    axes.figure.colorbar(shown, ax=axes, shrink=0.8, label=escaped(label), extend=extend)
    style_axes(axes, f"[{', '.join(map(str, values.shape))}]")
    if titles:
        axes.set_title(axes.get_title("left"), fontsize=10, loc="left", pad=16)
    axes.set_axis_off()


KINDS: dict[str, Callable[[Axes, Events], None]] = {
    "frame": _frame,
    "cloud": _cloud,
    "rate": _rate,
    "polarity": _polarity,
    "histogram": _histogram,
}
