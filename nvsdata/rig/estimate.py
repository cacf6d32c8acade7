"""Estimate of the time and disk of recording videos from a monitor."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from nvsdata.batch.estimate import Estimate, evenly_spaced
from nvsdata.batch.folder import Video
from nvsdata.recording.capture import RESERVE
from nvsdata.rig.clock_fit import flashes
from nvsdata.rig.playback import FADE, SETTLE, STEP, STILL
from nvsdata.video.decoder import length_of

LISTED = 50  # videos whose length is read; the others are assumed to be alike
OVERHEAD = 2_000_000  # µs per take for starting, trimming and checking
USUAL = 2_000_000  # bytes per second of video if there are no recordings yet: 250,000 events/s


def estimate_recording(videos: Sequence[Video], lines: Sequence[dict[str, Any]], out: Path, refresh: float) -> Estimate:
    """Return the time and disk that recording videos will need.

    Args:
        videos: Videos to record.
        lines: Lines of the manifest, whose recordings give the bytes per second of video.
        out: Folder of the recordings.
        refresh: Time in µs from one image of the screen to the next.
    """
    known = [length for video in evenly_spaced(videos, LISTED) if (length := length_of(video.path)[1])]
    each = float(np.mean(known)) if known else 0.0
    pattern = 2 * STILL + (flashes().size + 1) * STEP * refresh
    seconds = len(videos) * (each + (2 * pattern + SETTLE + 2 * FADE + OVERHEAD) / 1e6)
    recorded = [(line["recording"], line["duration"] / 1e6) for line in lines if line.get("duration")]
    rate = sum(size for size, _ in recorded) / sum(time for _, time in recorded) if recorded else USUAL
    return Estimate.on_disk(out, len(videos), seconds, round(each * len(videos) * rate), reserve=RESERVE)
