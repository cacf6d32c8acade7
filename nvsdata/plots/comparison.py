"""Emulated events beside real ones, and how a search came closer to them."""

from __future__ import annotations

import numpy as np

from nvsdata.data.events import Events
from nvsdata.plots.charts import curves
from nvsdata.plots.events import event_image
from nvsdata.plots.sheets import contact_sheet

SHOTS = 6  # moments that a picture shows of a recording
LEAST_WIDTH = 160  # pixels; smaller sensors are drawn larger


def side_by_side(a: Events, b: Events, fps: float, offset: int = 0) -> np.ndarray:
    """Both recordings at the same moments, in two rows; uint8 [H, W, 3], BGR.

    - `a`, `b`: events, for the upper and the lower row
    - `fps`: each picture shows 1 / fps s of events
    - `offset`: µs that are added to the times of `b` (default 0)
    """
    origins = (a.start, b.start - offset)
    span = max(events.end - origin for events, origin in zip((a, b), origins, strict=True))
    length = round(1e6 / fps)
    starts = np.linspace(0, max(span - length, 0), SHOTS).astype(int).tolist()
    zoom = max(1, LEAST_WIDTH // a.sensor_size[0])
    rows = [
        (name, [event_image(events.window(origin + s, origin + s + length), zoom) for s in starts])
        for name, events, origin in zip("AB", (a, b), origins, strict=True)
    ]
    return contact_sheet(rows, margin=24)


def score_curve(scores: np.ndarray) -> np.ndarray:
    """The score of each trial, and the best so far, against the trial's number; uint8 [H, W, 3], BGR.

    - `scores`: of each trial, [N]; inf is drawn as the highest finite one
    """
    highest = float(scores[np.isfinite(scores)].max())
    each = np.minimum(scores, highest)
    lines = [("each trial", each.tolist()), ("best so far", np.minimum.accumulate(each).tolist())]
    return curves(lines, "weighted score (lower is closer)", "trial", highest=highest)
