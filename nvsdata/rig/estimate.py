"""How long a batch will take, and how much disk, before it starts."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from nvsdata.batch.folder import Video
from nvsdata.recording.capture import RESERVE
from nvsdata.rig.clock_fit import flashes
from nvsdata.rig.playback import FADE, SETTLE, STEP, STILL
from nvsdata.video.decoder import length_of

LOOKED_AT = 50  # videos whose length is looked up; those of the others are taken to be alike
BESIDE = 2_000_000  # µs per take for starting, cutting and judging
USUAL = 2_000_000  # bytes per second of video, if nothing was recorded yet: 250,000 events/s


class Estimate(NamedTuple):
    """What a batch will need, in words, and whether the disk is too small for it."""

    text: str
    short: bool


def estimate_recording(videos: Sequence[Video], lines: Sequence[dict[str, Any]], out: Path, refresh: float) -> Estimate:
    """The time and the disk that videos will need.

    - `lines`: of the manifest, whose recordings say how much a second of video takes
    - `refresh`: µs from one picture of the screen to the next
    """
    some = [videos[n] for n in np.unique(np.linspace(0, len(videos) - 1, min(LOOKED_AT, len(videos))).astype(int))]
    known = [length for video in some if (length := length_of(video.path)[1])]
    each = float(np.mean(known)) if known else 0.0
    pattern = 2 * STILL + (flashes().size + 1) * STEP * refresh
    seconds = len(videos) * (each + (2 * pattern + SETTLE + 2 * FADE + BESIDE) / 1e6)
    recorded = [(line["recording"], line["duration"] / 1e6) for line in lines if line.get("duration")]
    rate = sum(size for size, _ in recorded) / sum(time for _, time in recorded) if recorded else USUAL
    needed, free = each * len(videos) * rate, shutil.disk_usage(out).free
    hours, minutes = divmod(round(seconds / 60), 60)
    text = f"{len(videos):,} videos: about {hours} h {minutes:02} min and {needed / 1e9:,.1f} GB"
    text += f"; {free / 1e9:,.1f} GB of disk are free"
    short = bool(videos) and needed + RESERVE > free
    return Estimate(f"{text}, which is too little" if short else text, short)
