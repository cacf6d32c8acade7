"""HTML page with images and statistics of every class of a dataset."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from dataclasses import dataclass, field

import cv2
import numpy as np

from nvsdata.common.text import as_html
from nvsdata.data.events import Events
from nvsdata.plots.drawing import event_image, middle

SHOWN = 50_000  # µs of events in an image

COLUMNS = "class", "recordings", "read", "events", "events/s", "seconds", "ON", "at the midpoint"
STYLE = """
:root { color-scheme: light dark; --page: #fff; --text: #3c3c3c; --faint: #6b6b6b; --line: #e6e6e6; }
@media (prefers-color-scheme: dark) { :root { --page: #161616; --text: #ddd; --faint: #a0a0a0; --line: #3a3a3a; } }
body { font: 14px system-ui, sans-serif; color: var(--text); background: var(--page); }
body { margin: 0 auto; padding: 16px; max-width: 1500px; }
h1, li { overflow-wrap: anywhere; }
table { border-collapse: collapse; }
th { text-align: left; font-weight: 600; position: sticky; top: 0; background: var(--page); }
td, th { padding: 4px 12px 4px 0; border-bottom: 1px solid var(--line); vertical-align: middle; }
td.n { text-align: right; font-variant-numeric: tabular-nums; white-space: nowrap; }
img { height: 120px; image-rendering: pixelated; border: 1px solid var(--line); margin-right: 4px; }
p { color: var(--faint); }
"""
# on a phone, a class is a block: its name, a line for each number, images
NARROW = """
@media (max-width: 700px) {
  table, tbody, tr, td { display: block; }
  tr { padding: 10px 0; border-bottom: 1px solid var(--line); }
  tr:has(th) { display: none; }
  td, td.n { border: 0; padding: 1px 0; text-align: left; overflow-wrap: anywhere; }
  td:first-child { font-weight: 600; }
  td.n::before { display: inline-block; width: 90px; color: var(--faint); }
  img { max-width: 100%; object-fit: contain; box-sizing: border-box; }
LABELS}
""".replace(
    "LABELS",
    "".join(f'  td.n:nth-child({n})::before {{ content: "{name}"; }}\n' for n, name in enumerate(COLUMNS[1:-1], 2)),
)


@dataclass
class ClassSummary:
    """Statistics and images of a class.

    Args:
        name: Name of the class.
        recordings: Number of recordings of the class.
        events: Number of events of each recording that was read.
        seconds: Time from the first to the last event of each recording that was read, in s.
        on: Number of ON events of each recording that was read.
        images: Name and PNG of some recordings.
    """

    name: str
    recordings: int
    events: list[int] = field(default_factory=list)
    seconds: list[float] = field(default_factory=list)
    on: list[int] = field(default_factory=list)
    images: list[tuple[str, bytes]] = field(default_factory=list)

    def add(self, events: Events) -> None:
        """Add a recording to the statistics."""
        self.events.append(len(events))
        self.seconds.append(events.duration / 1e6)
        self.on.append(int(np.count_nonzero(events.p)))

    def show(self, name: str, events: Events) -> None:
        """Add an image of the 50 ms at the midpoint of a recording."""
        image = event_image(middle(events, SHOWN))
        self.images.append((name, cv2.imencode(".png", image)[1].tobytes()))

    def cells(self) -> list[str]:
        """Return the cells of the class's row: medians over recordings; rate and fraction of ON over all events."""
        if not self.events:
            return [f"{self.recordings:,}", "0", *[""] * 4]
        total, time = sum(self.events), sum(self.seconds)
        return [
            f"{self.recordings:,}",
            f"{len(self.events):,}",
            f"{np.median(self.events):,.0f}",
            f"{total / time:,.0f}" if time else "",
            f"{np.median(self.seconds):,.3g}",
            f"{sum(self.on) / total:.1%}" if total else "",
        ]


def gallery(title: str, classes: Sequence[ClassSummary], faults: Sequence[str] = ()) -> str:
    """Return an HTML page of the classes, which needs no other files.

    Args:
        title: Title of the page.
        classes: A row for each class, with its statistics and images.
        faults: Messages about recordings that couldn't be read.
    """
    rows = [_row(as_html(one.name), one) for one in classes]
    if len(classes) > 1:
        rows.append(_row("<b>all</b>", _total(classes)))
    head = "".join(f"<th>{column}</th>" for column in COLUMNS)
    listed = "".join(f"<li>{as_html(fault)}</li>" for fault in faults)
    wrong = f"<h2>Not read: {len(faults)}</h2><ul>{listed}</ul>" if faults else ""
    name = as_html(title)
    about = "Events and seconds are medians. Images: ON red, OFF blue, both purple."
    return (
        f'<!doctype html><html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{name}</title><style>{STYLE}{NARROW}</style></head>"
        f"<body><h1>{name}</h1><p>{about}</p><table><tr>{head}</tr>\n"
        + "\n".join(rows)
        + f"</table>{wrong}</body></html>"
    )


def _row(name: str, summary: ClassSummary) -> str:
    cells = "".join(f'<td class="n">{cell}</td>' for cell in summary.cells())
    return f"<tr><td>{name}</td>{cells}<td>{image_tags(summary)}</td></tr>"


def image_tags(summary: ClassSummary, style: str = "") -> str:
    """Return the images of a class as HTML elements with the CSS `style`."""
    return "".join(
        f'<img alt="{as_html(title)}" title="{as_html(title)}" style="{style}" '
        f'src="data:image/png;base64,{base64.b64encode(png).decode()}">'
        for title, png in summary.images
    )


def _total(classes: Sequence[ClassSummary]) -> ClassSummary:
    total = ClassSummary("", sum(one.recordings for one in classes))
    for one in classes:
        total.events += one.events
        total.seconds += one.seconds
        total.on += one.on
    return total
