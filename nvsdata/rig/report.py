"""HTML report of a batch: videos to record again, recordings to review, and statistics over the batch."""

from __future__ import annotations

import base64
import math
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np

from nvsdata.common.files import put
from nvsdata.common.text import as_html
from nvsdata.plots.charts import timeline
from nvsdata.rig import content, take

REPORT = "report.html"
SHEETS = "contact-sheet-*.png"
FLAGGED = "contact-sheet-000.png"
FEWEST = 10  # recordings from which a chart is drawn
STYLE = (
    "body{font:15px/1.45 system-ui,sans-serif;max-width:1100px;margin:2em auto;padding:0 1em}"
    "body{color:#222;background:#fff}"
    "table{border-collapse:collapse;font-size:13px;display:block;overflow-x:auto}"
    "td,th{padding:3px 9px;border-bottom:1px solid #ddd;text-align:left;vertical-align:top}"
    "td.n,th.n{text-align:right}td.n{white-space:nowrap}td.w{min-width:11em;overflow-wrap:anywhere}"
    "dt{font-weight:600}dd{margin:0 0 .5em 1.5em}img{max-width:100%}"
    "@media(prefers-color-scheme:dark){body{color:#ddd;background:#181818}td,th{border-color:#444}a{color:#8bf}}"
)
Line = dict[str, Any]  # a line of a manifest


class Figure(NamedTuple):
    """A statistic of each recording of a batch.

    Args:
        name: Name of the statistic.
        value: Function that returns the value for a line of the manifest.
        form: Format of numbers.
        meaning: Explanation for the legend.
        low: Value below which recordings are flagged or takes rejected.
        high: Value above which recordings are flagged or takes rejected.
        relative: The same limits as fractions of the batch's median.
        column: Show the statistic in the table.
        curve: Show the statistic in a chart over the batch.
    """

    name: str
    value: Callable[[Line], Any]
    form: str
    meaning: str
    low: float = -math.inf
    high: float = math.inf
    relative: tuple[float, float] = (-math.inf, math.inf)
    column: bool = True
    curve: bool = False

    def limits(self, values: Sequence[float]) -> list[float]:
        """Return the limits for recordings of a batch with these values."""
        usual = float(np.nanmedian(values))
        low, high = (share * usual if math.isfinite(share) else share for share in self.relative)
        return [limit for limit in (max(self.low, low), min(self.high, high)) if math.isfinite(limit)]


LOW, HIGH = content.RELATIVE["scale"]
FIGURES = (
    Figure("seconds", lambda line: line["duration"] / 1e6, ",.2f", "Length of the recording."),
    Figure("events/s", lambda line: line["events"] / (line["duration"] / 1e6), ",.0f", "Events per second."),
    Figure(
        "events per emulated event",
        lambda line: line["content"]["scale"],
        ",.2f",
        "Events that were recorded for each event that the emulator PIX2NVS returns for the video in the same view, "
        f"in the median over time. Flagged below {content.LEAST_SCALE:g} and above {content.MOST_SCALE:g}, and below "
        f"{LOW:g} and above {HIGH:g} times the median of the other recordings. Empty for a video that hardly moves.",
        low=content.LEAST_SCALE,
        high=content.MOST_SCALE,
        relative=content.RELATIVE["scale"],
        curve=True,
    ),
    Figure(
        "noise, Hz",
        lambda line: line["content"]["noise"],
        ",.2f",
        "Events per second and pixel while the first frame of the video is still. "
        f"Flagged above {content.MOST_NOISE:g}.",
        high=content.MOST_NOISE,
        curve=True,
    ),
    Figure(
        "gap, ms",
        lambda line: line["content"]["gap"],
        ",.0f",
        f"Longest time without events in which the video moves. Flagged above {content.LONGEST_GAP:g}.",
    ),
    Figure(
        "hidden",
        lambda line: line["content"]["hidden"],
        ".0%",
        "Fraction of the video's motion that is in parts of the sensor without events: something may be in front of "
        "the screen. "
        f"Flagged above {content.MOST_HIDDEN:.0%}.",
    ),
    Figure(
        "stray",
        lambda line: line["content"]["stray"],
        ".0%",
        f"Fraction of the events where, or when, nothing moves in the video. Flagged above {content.MOST_STRAY:.0%}.",
    ),
    Figure(
        "wrong frame, ms",
        lambda line: line["wrong"],
        ",.0f",
        "Time for which the screen showed an outdated frame. A take with more than "
        f"{take.MOST_WRONG:g} ms, or {take.SHARE_WRONG:.0%} of a longer video, is rejected.",
    ),
    Figure("takes", lambda line: line["takes"], ",.0f", "Number of takes until one was good."),
    Figure(
        "clock drift, ppm",
        lambda line: line["sync"]["drift"] * 1e6,
        ",.1f",
        "Speed of the camera's clock relative to the computer's, minus 1, in millionths.",
        column=False,
        curve=True,
    ),
    Figure(
        "flash error, µs",
        lambda line: line["sync"]["residual"],
        ",.1f",
        "Median distance of the flashes before and after the video from the line fitted to their times. "
        f"A take above {take.WORST_RESIDUAL:,} is rejected.",
        high=take.WORST_RESIDUAL,
        column=False,
        curve=True,
    ),
    Figure(
        "flashes seen",
        lambda line: line["content"]["seen"],
        ".0%",
        "Mean fraction of the flashes that a pixel of the screen's image recorded. "
        f"Flagged below {content.RELATIVE['seen'][0]:g} times the median of the other recordings.",
        relative=content.RELATIVE["seen"],
        column=False,
        curve=True,
    ),
    Figure(
        "temperature, °C",
        lambda line: line["temperature"],
        ",.1f",
        "Temperature of the camera.",
        column=False,
        curve=True,
    ),
)
WORDS = {
    "recorded": "The recording passed all checks that reject a take.",
    "truncated": "The video is truncated, and was recorded as far as it can be decoded.",
    "failed": 'There is no good recording; the column "why" has the reason. record --resume records the video again.',
    "to review": 'The recording is kept, but something about it is unusual; the column "why" has the details.',
}


def write_batch_report(lines: Sequence[Line], head: Line, out: Path) -> None:
    """Write `out/report.html`, which needs no other files except the contact sheets next to it.

    Args:
        lines: The last line of each video in the manifest.
        head: The first line of the manifest.
        out: Folder of the recordings.
    """
    sheets = sorted(path.name for path in out.glob(SHEETS))
    put(out / REPORT, report_page(lines, head, out.resolve().name, sheets).encode("utf-8", "backslashreplace"))


def report_page(lines: Sequence[Line], head: Line, name: str, sheets: Sequence[str] = ()) -> str:
    """Return the page as HTML, with links to the contact sheets."""
    done = [line for line in lines if line["status"] in ("recorded", "truncated")]
    again = [line for line in lines if line["status"] != "recorded"]
    flagged = [line for line in lines if line["status"] == "recorded" and line.get("review")]
    fine = [line for line in lines if line["status"] == "recorded" and not line.get("review")]
    seconds = sum(_number(lambda line: line["duration"], line) or 0 for line in done)
    events = sum(_number(lambda line: line["events"], line) or 0 for line in done)
    refresh = _number(lambda head: head["monitor"]["refresh"], head)
    texts = [
        f"{len(fine):,} recordings without findings, {len(flagged):,} to review, {len(again):,} to record again",
        f"{seconds / 1e6:,.0f} s"
        + (f" ({seconds / 6e7:,.0f} minutes)" if seconds > 12e7 else "")
        + f", {events:,.0f} events",
        *([f"screen of {1e6 / refresh:.2f} Hz"] if refresh else []),
        *dict.fromkeys(str(line["note"]) for line in lines if line.get("note")),
    ]
    parts = [f"<p>{as_html(text)}</p>" for text in texts] + _links(sheets)
    for title, some in (("To record again", again), ("To review", flagged), ("Without findings", fine)):
        if some:
            parts.append(f"<h2>{title}: {len(some):,}</h2>{_table(some)}")
    charts = [chart for figure in FIGURES if figure.curve and (chart := _chart(figure, done))]
    parts += ["<h2>Over the batch</h2>", *charts] if charts else []
    parts.append(_legend(bool(charts)))
    title = as_html(f"Recordings in {name}")
    begin = (
        '<!doctype html><html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width">'
        f"<title>{title}</title><style>{STYLE}</style></head>"
    )
    return f"{begin}<body><h1>{title}</h1>{''.join(parts)}</body></html>"


def _links(sheets: Sequence[str]) -> list[str]:
    """Return links to the contact sheets, first to that of flagged recordings."""
    if not sheets:
        return []
    links = [
        f'<a href="{as_html(sheet)}">{"flagged recordings" if sheet == FLAGGED else as_html(sheet)}</a>'
        for sheet in sheets
    ]
    return [f"<p>Contact sheets, with the frame and the events at the midpoint of each video: {', '.join(links)}</p>"]


def _table(lines: Sequence[Line]) -> str:
    columns = [figure for figure in FIGURES if figure.column]
    names = "".join(f'<th class="n">{as_html(figure.name)}</th>' for figure in columns)
    rows = [f"<th>video</th><th>status</th><th>why</th>{names}"]
    for line in lines:
        row = "".join(f"<td>{as_html(line[key])}</td>" for key in ("video", "status"))
        review = line.get("review") or []
        words = "; ".join(map(str, [*([line["reason"]] if "reason" in line else []), *review]))
        row += f'<td class="w">{as_html(words)}</td>'
        for figure in columns:
            value = _number(figure.value, line)
            row += f'<td class="n">{"" if value is None else format(value, figure.form)}</td>'
        rows.append(row)
    return "<table>" + "".join(f"<tr>{row}</tr>" for row in rows) + "</table>"


def _legend(charts: bool) -> str:
    """Return the explanations of the page's terms."""
    known = WORDS | {figure.name: figure.meaning for figure in FIGURES if figure.column or charts}
    terms = "".join(f"<dt>{as_html(name)}</dt><dd>{as_html(text)}</dd>" for name, text in known.items())
    return f"<h2>Terms</h2><dl>{terms}</dl>"


def _number(value: Callable[[Line], Any], line: Line) -> float | None:
    """Return a statistic of a line, or None if the line doesn't have it."""
    try:
        found = float(value(line))
    except (KeyError, TypeError, ValueError, ArithmeticError):
        return None
    return found if math.isfinite(found) else None


def _chart(figure: Figure, lines: Iterable[Line]) -> str:
    """Return a chart of a statistic over the batch, empty if few recordings have it."""
    values = [_number(figure.value, line) for line in lines]
    if sum(value is not None for value in values) < FEWEST:
        return ""
    given = [np.nan if value is None else value for value in values]
    drawn = timeline(given, figure.name, "recording", limits=figure.limits(given), form=figure.form)
    _, png = cv2.imencode(".png", drawn)
    data = base64.b64encode(png.tobytes()).decode()
    return f'<p><img alt="{as_html(figure.name)}" src="data:image/png;base64,{data}"></p>'
