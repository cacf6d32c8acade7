"""HTML page with charts and tables of measurements, in one file without dependencies."""

from __future__ import annotations

import io
import math
import re
from collections.abc import Sequence
from typing import TYPE_CHECKING

from nvsdata.benchmarks.curves import bends_upward, by_benchmark, exponent, is_scaling, is_tradeoff, pareto_indices
from nvsdata.benchmarks.measurement import OURS, Measurement
from nvsdata.benchmarks.table import benchmark_table
from nvsdata.benchmarks.tasks import TASKS
from nvsdata.common.errors import shown
from nvsdata.common.text import as_html
from nvsdata.plots.axes import LINES, escaped, new_chart

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SIZE = 620, 380  # pixels
EXACT = 10.0  # exact results are drawn this factor below the smallest error

STYLE = """
body { font: 14px system-ui, sans-serif; color: #3c3c3c; margin: 0 auto; padding: 16px; max-width: 1300px; }
pre { font: 12px ui-monospace, monospace; background: #f6f6f6; padding: 8px; overflow-x: auto; }
figure { display: inline-block; margin: 0 12px 12px 0; max-width: 100%; }
figure svg { max-width: 100%; height: auto; }
p { color: #777; } nav a { margin-right: 12px; }
.bent { color: #b00020; }
"""


def benchmark_page(measurements: Sequence[Measurement]) -> str:
    """Return an HTML page: for each task, charts of its benchmarks, then their tables.

    A chart of settings shows time against error, the Pareto front as a line, and a ring around the default. A chart of
    sizes shows time against size on logarithmic axes, and states the exponent. Exact results are drawn at a
    dotted line, at a tenth of the smallest error.
    """
    tasks = list(dict.fromkeys(one.task for one in measurements))
    places = sorted({(one.machine, one.commit, one.date) for one in measurements})
    origin = "<br>".join(as_html(f"{machine}; commit {commit}; {date}") for machine, commit, date in places)
    links = "".join(f'<a href="#{task}">{task}</a>' for task in map(as_html, tasks))
    sections = "".join(_section(task, [one for one in measurements if one.task == task]) for task in tasks)
    return (
        f'<!doctype html><html lang="en"><meta charset="utf-8"><title>nvsdata bench</title><style>{STYLE}</style>'
        f"<h1>Run time against error</h1><p>{origin}</p><nav>{links}</nav>{sections}</html>\n"
    )


def _section(task: str, measurements: Sequence[Measurement]) -> str:
    groups = by_benchmark(measurements)
    figures = "".join(_figure(group) for group in groups)
    tables = (as_html(benchmark_table(group), "\n") for group in groups)
    text = "".join(f"<pre>{table}</pre>" for table in tables)
    name, about = as_html(task), as_html(TASKS.get(task, ""))
    return f'<h2 id="{name}">{name}: {about}</h2>{figures}{text}'


def _figure(measurements: Sequence[Measurement]) -> str:
    """Return the chart of a benchmark; empty if it has one point only."""
    ours = [one for one in measurements if one.library == OURS]
    if is_tradeoff(measurements):
        drawn, caption = _tradeoff(measurements), _about_default(ours)
    elif len({one.place for one in ours if not math.isnan(one.place)}) > 1:
        drawn = _growth(measurements)
        caption = as_html(f"grows as {ours[0].axis}^{exponent(ours):.2f}") if is_scaling(measurements) else ""
        if is_scaling(measurements) and bends_upward(ours):
            caption = f'<span class="bent">{caption}, and bends upward</span>'
    else:
        return ""
    return f"<figure>{drawn}<figcaption>{caption}</figcaption></figure>"


def _about_default(ours: Sequence[Measurement]) -> str:
    """State whether the default is on the Pareto front."""
    known = [one for one in ours if one.error is not None]
    best = pareto_indices([(one.error or 0.0, one.seconds) for one in known])
    default = [i for i, one in enumerate(known) if one.default]
    return f"the default {'is' if default[0] in best else 'is not'} on the Pareto front" if default else ""


def _tradeoff(measurements: Sequence[Measurement]) -> str:
    """Draw times of settings against their errors."""
    known = [one for one in measurements if one.error is not None]
    least = min((one.error for one in known if one.error), default=1.0)
    figure, axes = _axes(measurements[0], measurements[0].error_kind)
    places = [max(one.error or 0.0, least / EXACT) for one in known]
    best = pareto_indices([(one.error or 0.0, one.seconds) for one in known])
    axes.plot([places[i] for i in best], [known[i].seconds * 1e3 for i in best], color=LINES[0], zorder=2)
    for i, (place, one) in enumerate(zip(places, known, strict=True)):
        color = LINES[0] if i in best else LINES[1]
        axes.scatter([place], [one.seconds * 1e3], color=color, s=22, zorder=3)
        if one.default:
            axes.scatter([place], [one.seconds * 1e3], facecolors="none", edgecolors=color, s=90, zorder=3)
        name = str(one.settings.get(one.axis, "")) if one.library == OURS else one.library
        axes.annotate(escaped(name), (place, one.seconds * 1e3), (4, 4), textcoords="offset points", fontsize=7)
    if any(not one.error for one in known):
        axes.axvline(least / EXACT, color="#cccccc", linestyle=":", zorder=1)
        axes.annotate("exact", (least / EXACT, 0), (2, 2), xycoords=("data", "axes fraction"), fontsize=7,
                      textcoords="offset points")  # fmt: skip
    return _svg(figure, measurements[0].benchmark)


def _growth(measurements: Sequence[Measurement]) -> str:
    """Draw times against sizes or fractions."""
    figure, axes = _axes(measurements[0], measurements[0].axis)
    for number, library in enumerate(dict.fromkeys(one.library for one in measurements)):
        points = sorted((one.place, one.seconds * 1e3) for one in measurements if one.library == library)
        # 0 has no logarithm
        least = min((place for place, _ in points if place > 0), default=1.0)
        places = [max(place, least / EXACT) for place, _ in points]
        color = LINES[number % len(LINES)]
        axes.plot(places, [time for _, time in points], "o-", color=color, markersize=4, label=escaped(library))
    if len({one.library for one in measurements}) > 1:
        axes.legend(fontsize=7)
    return _svg(figure, measurements[0].benchmark)


def _axes(one: Measurement, xlabel: str) -> tuple[Figure, Axes]:
    figure, axes = new_chart(SIZE, one.benchmark, xlabel, "ms")
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.margins(0.1)
    return figure, axes


def _svg(figure: Figure, name: str) -> str:
    """Return a chart as an SVG element; `name` distinguishes the ids of its parts from those of other charts."""
    import matplotlib

    stream = io.StringIO()
    # the same measurements make the same page
    with matplotlib.rc_context({"svg.hashsalt": shown(name), "svg.fonttype": "none"}):
        figure.savefig(stream, format="svg", metadata={"Date": None, "Creator": None})
    text = stream.getvalue()
    return re.sub(r"\s*<metadata>.*?</metadata>", "", text[text.index("<svg") :], flags=re.DOTALL)
