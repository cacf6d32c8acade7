"""HTML page that plays events and shows them as a point cloud in space and time, in one file without dependencies."""

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
MOST_EVENTS = 20_000_000  # a page of 210 MB


def player_page(
    events: Events,
    title: str,
    frames: Iterable[Frame] = (),
    window: int | None = None,
    origin: int | None = None,
) -> str:
    """Return an HTML page of all events: a player, a chart of the event rate over time, and a point cloud.

    The player has controls for time, speed and window length.

    Args:
        events: The events. 2 million events make a page of 21 MB.
        title: Title of the page.
        frames: Frames of the same camera, shown behind the events. If there are more than 600, only every n-th
            frame is shown, so that at most 600 are left.
        window: Initial length of the window in µs (default: 33,333, but at most a tenth of the recording).
        origin: Time in µs that the player shows as 0 (default: that of the first event).

    Returns:
        The HTML text.

    Raises:
        ValueError: If there are more than 20 million events.

    Example:
        >>> player_page(Events([0, 10], [0, 3], [1, 1], [1, 0]), "two events")[:15]
        '<!doctype html>'
    """
    if len(events) > MOST_EVENTS:
        raise ValueError(
            f"a page of {len(events):,} events is too large for browsers: select a part (up to {MOST_EVENTS:,} events)"
        )
    t, x, y, p = events.columns
    span = events.end - events.start
    # times are stored in 32 bits, which are 71 minutes in µs
    unit = max(1, -(-span // (2**32 - 1)))
    width, height = events.sensor_size
    data = {
        "unit": unit,
        "span": int(span),
        "offset": int(events.start - origin) if origin is not None else 0,
        "size": [width, height],
        "window": int(min(window or min(WINDOW, span // 10), span)) or 1,
        "t": _text(((t - events.start) // unit).astype("<u4")),
        # coordinates need 15 bits, so the 16th is the polarity
        "xp": _text(x.astype("<u2") | (p.astype("<u2") << 15)),
        "y": _text(y.astype("<u2")),
        "frames": [_photo(frame, events.start) for frame in _some(list(frames))],
    }
    about = f"{len(events):,} events, {span / 1e3:,.1f} ms, {width}x{height} pixels"
    about += f", {events.p.mean():.0%} ON" if len(events) else ""
    text, script = (files("nvsdata.plots").joinpath(f"viewer.{kind}").read_text("utf-8") for kind in ("html", "js"))
    filled = {"__TITLE__": as_html(title), "__ABOUT__": about, "__DATA__": as_script(data), "__SCRIPT__": script}
    # placeholders are replaced in one pass, because a title may contain one of them
    return re.sub("|".join(filled), lambda found: filled[found[0]], text)


def _text(column: np.ndarray) -> str:
    return base64.b64encode(np.ascontiguousarray(column).tobytes()).decode()


def _some(frames: list[Frame]) -> list[Frame]:
    return frames[:: -(-len(frames) // MOST_FRAMES) or 1]


def _photo(frame: Frame, start: int) -> dict[str, object]:
    """Return a frame as JPEG, with its brightness stretched to the full range."""
    low, high = (float(bound) for bound in np.percentile(frame.pixels, (0.5, 99.5)))
    gray = ((frame.pixels - low) * (255 / max(high - low, 1))).clip(0, 255).astype(np.uint8)
    encoded = cv2.imencode(".jpg", gray, (cv2.IMWRITE_JPEG_QUALITY, 80))[1]
    place = {"x": frame.x, "y": frame.y, "at": int(frame.exposure_start - start)}
    return {**place, "image": base64.b64encode(encoded.tobytes()).decode()}
