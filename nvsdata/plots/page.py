"""A page that plays events and shows them as a cloud in space and time, in one file that needs nothing else."""

from __future__ import annotations

import base64
import re
from collections.abc import Iterable
from importlib.resources import files

import cv2
import numpy as np

from nvsdata.common.text import as_html, as_script
from nvsdata.data.events import Events
from nvsdata.data.samples import Frame
from nvsdata.plots.films import WINDOW

MOST_FRAMES = 600
MOST_EVENTS = 20_000_000  # 210 MB


def page(events: Events, title: str, frames: Iterable[Frame] = (), window: int | None = None) -> str:
    """An HTML page with all of the events: a player with scrubber, speed and window length; rate over time; a cloud.

    - `events`: at any times; 2 million of them make a page of 21 MB
    - `title`: of the page
    - `frames`: pictures of the same camera, shown behind the events; of more than 600, every second or third ...
    - `window`: length of the window at first, in µs (default: 33,333, or a tenth of what is shorter than ten of these)

    ValueError for more than 20 million events.
    """
    if len(events) > MOST_EVENTS:
        raise ValueError(
            f"a page of {len(events):,} events is more than browsers take: take a part (up to {MOST_EVENTS:,})"
        )
    t, x, y, p = events.columns
    span = events.end - events.start
    # 32 bits of µs are 71 minutes
    unit = max(1, -(-span // (2**32 - 1)))
    width, height = events.sensor_size
    data = {
        "unit": unit,
        "span": int(span),
        "size": [width, height],
        "window": int(min(window or min(WINDOW, span // 10), span)) or 1,
        "t": _text(((t - events.start) // unit).astype("<u4")),
        # coordinates have 15 bits
        "xp": _text(x.astype("<u2") | (p.astype("<u2") << 15)),
        "y": _text(y.astype("<u2")),
        "frames": [_photo(frame, events.start) for frame in _some(list(frames))],
    }
    about = f"{len(events):,} events, {span / 1e3:,.1f} ms, {width}x{height} pixels"
    about += f", {events.p.mean():.0%} ON" if len(events) else ""
    filled = {"__TITLE__": as_html(title), "__ABOUT__": about, "__DATA__": as_script(data)}
    text = files("nvsdata.plots").joinpath("viewer.html").read_text("utf-8")
    # at once, because a title may hold another's name
    return re.sub("|".join(filled), lambda found: filled[found[0]], text)


def _text(column: np.ndarray) -> str:
    return base64.b64encode(np.ascontiguousarray(column).tobytes()).decode()


def _some(frames: list[Frame]) -> list[Frame]:
    return frames[:: -(-len(frames) // MOST_FRAMES) or 1]


def _photo(frame: Frame, start: int) -> dict[str, object]:
    """A frame, brightened to its own range, as JPEG."""
    low, high = (float(bound) for bound in np.percentile(frame.pixels, (0.5, 99.5)))
    gray = ((frame.pixels - low) * (255 / max(high - low, 1))).clip(0, 255).astype(np.uint8)
    encoded = cv2.imencode(".jpg", gray, (cv2.IMWRITE_JPEG_QUALITY, 80))[1]
    place = {"x": frame.x, "y": frame.y, "at": int(frame.exposure_start - start)}
    return {**place, "image": base64.b64encode(encoded.tobytes()).decode()}
