"""A page with the curves and tables of lines, in one file that needs nothing else."""

from __future__ import annotations

import io
import math
import re
from collections.abc import Sequence
from typing import TYPE_CHECKING

from nvsdata.benchmarks.curves import bends_upward, exponent, front, is_scaling, is_tradeoff, works
from nvsdata.benchmarks.line import OURS, Line
from nvsdata.benchmarks.table import work_table
from nvsdata.benchmarks.tasks import TASKS
from nvsdata.common.errors import shown
from nvsdata.common.text import as_html
from nvsdata.plots.axes import LINES, escaped, new_chart

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SIZE = 620, 380  # pixels
EXACT = 10.0  # factor below the smallest error at which no error is drawn

STYLE = """
body { font: 14px system-ui, sans-serif; color: #3c3c3c; margin: 0 auto; padding: 16px; max-width: 1300px; }
pre { font: 12px ui-monospace, monospace; background: #f6f6f6; padding: 8px; overflow-x: auto; }
figure { display: inline-block; margin: 0 12px 12px 0; max-width: 100%; }
figure svg { max-width: 100%; height: auto; }
p { color: #777; } nav a { margin-right: 12px; }
.bent { color: #b00020; }
"""


def results_page(lines: Sequence[Line]) -> str:
    """An HTML page: per task the curves of its works, then their tables.

    Settings that trade time for accuracy: error to the right, time upward, the front of what nothing surpasses as a
    line, a ring around the default. Sizes: size to the right, time upward, both logarithmic, with the exponent.
    """
    tasks = list(dict.fromkeys(line.task for line in lines))
    places = sorted({(line.machine, line.commit, line.date) for line in lines})
    origin = "<br>".join(as_html(f"{machine}; commit {commit}; {date}") for machine, commit, date in places)
    links = "".join(f'<a href="#{task}">{task}</a>' for task in map(as_html, tasks))
    sections = "".join(_section(task, [line for line in lines if line.task == task]) for task in tasks)
    return (
        f'<!doctype html><html lang="en"><meta charset="utf-8"><title>nvsdata bench</title><style>{STYLE}</style>'
        f"<h1>Run time against error</h1><p>{origin}</p><nav>{links}</nav>{sections}</html>\n"
    )


def _section(task: str, lines: Sequence[Line]) -> str:
    groups = works(lines)
    figures = "".join(_figure(group) for group in groups)
    tables = (as_html(work_table(group), "\n") for group in groups)
    text = "".join(f"<pre>{table}</pre>" for table in tables)
    name, about = as_html(task), as_html(TASKS.get(task, ""))
    return f'<h2 id="{name}">{name}: {about}</h2>{figures}{text}'


def _figure(lines: Sequence[Line]) -> str:
    """The curve of a work; none if nothing changes along it."""
    ours = [line for line in lines if line.library == OURS]
    if is_tradeoff(lines):
        drawn, caption = _tradeoff(lines), _about_default(ours)
    elif len({line.place for line in ours if not math.isnan(line.place)}) > 1:
        drawn = _growth(lines)
        caption = as_html(f"grows as {ours[0].axis}^{exponent(ours):.2f}") if is_scaling(lines) else ""
        if is_scaling(lines) and bends_upward(ours):
            caption = f'<span class="bent">{caption}, and bends upward</span>'
    else:
        return ""
    return f"<figure>{drawn}<figcaption>{caption}</figcaption></figure>"


def _about_default(ours: Sequence[Line]) -> str:
    """Say if the default is on the front."""
    known = [line for line in ours if line.error is not None]
    best = front([(line.error or 0.0, line.seconds) for line in known])
    default = [i for i, line in enumerate(known) if line.default]
    return f"the default {'is' if default[0] in best else 'is not'} on the front" if default else ""


def _tradeoff(lines: Sequence[Line]) -> str:
    """Errors and times of the settings."""
    known = [line for line in lines if line.error is not None]
    least = min((line.error for line in known if line.error), default=1.0)
    figure, axes = _axes(lines[0], lines[0].error_kind)
    places = [max(line.error or 0.0, least / EXACT) for line in known]
    best = front([(line.error or 0.0, line.seconds) for line in known])
    axes.plot([places[i] for i in best], [known[i].seconds * 1e3 for i in best], color=LINES[0], zorder=2)
    for i, (place, line) in enumerate(zip(places, known, strict=True)):
        color = LINES[0] if i in best else LINES[1]
        axes.scatter([place], [line.seconds * 1e3], color=color, s=22, zorder=3)
        if line.default:
            axes.scatter([place], [line.seconds * 1e3], facecolors="none", edgecolors=color, s=90, zorder=3)
        name = str(line.settings.get(line.axis, "")) if line.library == OURS else line.library
        axes.annotate(escaped(name), (place, line.seconds * 1e3), (4, 4), textcoords="offset points", fontsize=7)
    if any(not line.error for line in known):
        axes.axvline(least / EXACT, color="#cccccc", linestyle=":", zorder=1)
        axes.annotate("exact", (least / EXACT, 0), (2, 2), xycoords=("data", "axes fraction"), fontsize=7,
                      textcoords="offset points")  # fmt: skip
    return _svg(figure, lines[0].work)


def _growth(lines: Sequence[Line]) -> str:
    """Times along sizes, or along shares of what there is."""
    figure, axes = _axes(lines[0], lines[0].axis)
    for number, library in enumerate(dict.fromkeys(line.library for line in lines)):
        points = sorted((line.place, line.seconds * 1e3) for line in lines if line.library == library)
        # a share of 0 has no logarithm
        least = min((place for place, _ in points if place > 0), default=1.0)
        places = [max(place, least / EXACT) for place, _ in points]
        color = LINES[number % len(LINES)]
        axes.plot(places, [time for _, time in points], "o-", color=color, markersize=4, label=escaped(library))
    if len({line.library for line in lines}) > 1:
        axes.legend(fontsize=7)
    return _svg(figure, lines[0].work)


def _axes(line: Line, xlabel: str) -> tuple[Figure, Axes]:
    figure, axes = new_chart(SIZE, line.work, xlabel, "ms")
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.margins(0.1)
    return figure, axes


def _svg(figure: Figure, name: str) -> str:
    """The chart as an element of a page; `name` distinguishes its parts from those of others."""
    import matplotlib

    stream = io.StringIO()
    # the same lines give the same page
    with matplotlib.rc_context({"svg.hashsalt": shown(name), "svg.fonttype": "none"}):
        figure.savefig(stream, format="svg", metadata={"Date": None, "Creator": None})
    text = stream.getvalue()
    return re.sub(r"\s*<metadata>.*?</metadata>", "", text[text.index("<svg") :], flags=re.DOTALL)
