"""A page with pictures and figures of every class of a dataset."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from dataclasses import dataclass, field

import cv2
import numpy as np

from nvsdata.common.text import as_html
from nvsdata.data.events import Events
from nvsdata.plots.events import event_image, middle

SHOWN = 50_000  # µs of events that a picture shows

STYLE = """
body { font: 14px system-ui, sans-serif; color: #3c3c3c; margin: 0 auto; padding: 16px; max-width: 1500px; }
table { border-collapse: collapse; }
th { text-align: left; font-weight: 600; position: sticky; top: 0; background: #fff; }
td, th { padding: 4px 12px 4px 0; border-bottom: 1px solid #e6e6e6; vertical-align: middle; }
td.n { text-align: right; font-variant-numeric: tabular-nums; white-space: nowrap; }
img { height: 120px; image-rendering: pixelated; border: 1px solid #ddd; margin-right: 4px; }
p { color: #777; }
"""
COLUMNS = "class", "recordings", "read", "events", "events/s", "seconds", "ON", "in the middle"


@dataclass
class Shelf:
    """What is shown of a class.

    - `name`: of the class
    - `recordings`: how many there are
    - `events`, `seconds`, `on`: of each recording that was read: their number, time from first to last, and number of
      ON events
    - `pictures`: PNGs of some of them, and their names
    """

    name: str
    recordings: int
    events: list[int] = field(default_factory=list)
    seconds: list[float] = field(default_factory=list)
    on: list[int] = field(default_factory=list)
    pictures: list[tuple[str, bytes]] = field(default_factory=list)

    def add(self, events: Events) -> None:
        """Count a recording."""
        self.events.append(len(events))
        self.seconds.append(events.duration / 1e6)
        self.on.append(int(np.count_nonzero(events.p)))

    def show(self, name: str, events: Events) -> None:
        """Show the middle of a recording."""
        image = event_image(middle(events, SHOWN))
        self.pictures.append((name, cv2.imencode(".png", image)[1].tobytes()))

    def cells(self) -> list[str]:
        """Medians over recordings; the rate and the share of ON events are of all events together."""
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


def gallery(title: str, shelves: Sequence[Shelf], faults: Sequence[str] = ()) -> str:
    """An HTML page in one file: a row per class with its figures and pictures, and what couldn't be read."""
    rows = [_row(as_html(shelf.name), shelf) for shelf in shelves]
    if len(shelves) > 1:
        rows.append(_row("<b>all</b>", _joined(shelves)))
    head = "".join(f"<th>{column}</th>" for column in COLUMNS)
    listed = "".join(f"<li>{as_html(fault)}</li>" for fault in faults)
    wrong = f"<h2>Not read: {len(faults)}</h2><ul>{listed}</ul>" if faults else ""
    name = as_html(title)
    about = "Events and seconds are medians. Pictures: ON red, OFF blue, both purple."
    return (
        f'<!doctype html><html lang="en"><head><meta charset="utf-8"><title>{name}</title><style>{STYLE}</style></head>'
        f"<body><h1>{name}</h1><p>{about}</p><table><tr>{head}</tr>\n"
        + "\n".join(rows)
        + f"</table>{wrong}</body></html>"
    )


def _row(name: str, shelf: Shelf) -> str:
    cells = "".join(f'<td class="n">{cell}</td>' for cell in shelf.cells())
    return f"<tr><td>{name}</td>{cells}<td>{images(shelf)}</td></tr>"


def images(shelf: Shelf, style: str = "") -> str:
    """The pictures as HTML."""
    return "".join(
        f'<img alt="{as_html(title)}" title="{as_html(title)}" style="{style}" '
        f'src="data:image/png;base64,{base64.b64encode(png).decode()}">'
        for title, png in shelf.pictures
    )


def _joined(shelves: Sequence[Shelf]) -> Shelf:
    joined = Shelf("", sum(shelf.recordings for shelf in shelves))
    for shelf in shelves:
        joined.events += shelf.events
        joined.seconds += shelf.seconds
        joined.on += shelf.on
    return joined
