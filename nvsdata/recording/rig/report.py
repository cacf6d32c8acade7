"""A page about a batch: its figures over time, what is to be looked at, and what is to be recorded again."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from nvsdata.common.files import put
from nvsdata.common.markup import as_html
from nvsdata.plots.timelines import timeline
from nvsdata.video.manifest import Manifest

REPORT = "report.html"
STYLE = (
    "body{font:15px/1.45 system-ui,sans-serif;max-width:1100px;margin:2em auto;padding:0 1em}"
    "body{color:#222;background:#fff}"
    "table{border-collapse:collapse;font-size:13px;display:block;overflow-x:auto}"
    "td,th{padding:3px 9px;border-bottom:1px solid #ddd;text-align:left}td.n{text-align:right}img{max-width:100%}"
    "@media(prefers-color-scheme:dark){body{color:#ddd;background:#181818}td,th{border-color:#444}}"
)
# what is drawn over the batch: names, and where a line of the manifest has them
CURVES = {
    "drift of the camera's clock, ppm": lambda line: line["sync"]["drift"] * 1e6,
    "flashes off the fit, µs (median)": lambda line: line["sync"]["residual"],
    "events for the video's motion, beside PIX2NVS": lambda line: line["content"]["scale"],
    "noise, Hz per pixel": lambda line: line["content"]["noise"],
    "share of the flashes that the screen's pixels saw": lambda line: line["content"]["seen"],
    "camera's temperature, °C": lambda line: line["temperature"],
}
COLUMNS = (
    "video",
    "status",
    "seconds",
    "events/s",
    "beside PIX2NVS",
    "noise, Hz",
    "gap, ms",
    "stray",
    "wrong, ms",
    "what",
)


def write_report(manifest: Manifest, out: Path, note: str | None = None) -> None:
    """Write `out/report.html`, one file that needs nothing else.

    - `manifest`: of the folder of recordings
    - `note`: what is to be said besides, such as about the room (default: nothing)
    """
    put(out / REPORT, page(list(manifest.videos.values()), manifest.head, out.name, note).encode())


def page(lines: Sequence[dict[str, Any]], head: dict[str, Any], name: str, note: str | None) -> str:
    """The page as HTML."""
    done = [line for line in lines if "events" in line]
    again = [line for line in lines if line["status"] != "recorded"]
    odd = [line for line in lines if line["status"] == "recorded" and line.get("look")]
    fine = [line for line in lines if line["status"] == "recorded" and not line.get("look")]
    seconds, events = (sum(line[key] for line in done) for key in ("duration", "events"))
    screen = head.get("monitor", {})
    told = [
        f"{len(fine):,} recordings as they should be, {len(odd):,} to look at, {len(again):,} videos to record again",
        f"{seconds / 6e7:,.1f} minutes, {events:,} events",
        *([f"screen of {1e6 / screen['refresh']:.2f} Hz"] if screen.get("refresh") else []),
        *([note] if note else []),
    ]
    parts = [f"<p>{as_html(text)}</p>" for text in told]
    for title, some in (("To record again", again), ("To look at", odd), ("The others", fine)):
        if some:
            parts.append(f"<h2>{title}: {len(some):,}</h2>{_table(some)}")
        if title == "To look at":
            parts += [_picture(label, [_or_none(value, line) for line in done]) for label, value in CURVES.items()]
    title = as_html(f"Recordings in {name}")
    begin = (
        '<!doctype html><html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width">'
        f"<title>{title}</title><style>{STYLE}</style></head>"
    )
    return f"{begin}<body><h1>{title}</h1>{''.join(parts)}</body></html>"


def _table(lines: Sequence[dict[str, Any]]) -> str:
    rows = ["".join(f"<th>{column}</th>" for column in COLUMNS)]
    for line in lines:
        content, time = line.get("content") or {}, line.get("duration", 0) / 1e6
        rate = line["events"] / time if time else None
        figures = (
            time or None,
            rate,
            *(content.get(key) for key in ("scale", "noise", "gap", "stray")),
            line.get("wrong"),
        )
        words = "; ".join([*([line["reason"]] if "reason" in line else []), *line.get("look", ())])
        cells = [as_html(line["video"]), as_html(line["status"])]
        row = "".join(f"<td>{cell}</td>" for cell in cells)
        row += "".join(f'<td class="n">{"" if value is None else f"{value:,.4g}"}</td>' for value in figures)
        rows.append(f"{row}<td>{as_html(words)}</td>")
    return "<table>" + "".join(f"<tr>{row}</tr>" for row in rows) + "</table>"


def _or_none(value: Any, line: dict[str, Any]) -> float | None:
    try:
        found = value(line)
    except (KeyError, TypeError):
        return None
    return None if found is None else float(found)


def _picture(label: str, values: Sequence[float | None]) -> str:
    """A figure over the batch; nothing if no recording has it."""
    if not any(value is not None for value in values):
        return ""
    drawn = timeline([np.nan if value is None else value for value in values], label, "recording")
    _, png = cv2.imencode(".png", drawn)
    data = base64.b64encode(png.tobytes()).decode()
    return f'<p><img alt="{as_html(label)}" src="data:image/png;base64,{data}"></p>'
