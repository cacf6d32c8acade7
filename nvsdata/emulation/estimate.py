"""How long a folder of videos will take to convert, and how much disk, from pieces of a few of them."""

from __future__ import annotations

import shutil
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

import numpy as np

from nvsdata import formats
from nvsdata.emulation.job import Job
from nvsdata.video.decoder import length_of

LOOKED_AT = 5  # videos of which a piece is converted
LISTED = 200  # videos whose length is looked up; those of the others are taken to be alike
FRAMES = 60  # of a piece


@dataclass(frozen=True)
class Estimate:
    """What a conversion will take.

    - `videos`: how many
    - `frames`: of all of them, about
    - `seconds`: that one process takes, about
    - `bytes`: of the recordings, about
    - `free`: bytes of disk that are free where they go
    """

    videos: int
    frames: int
    seconds: float
    bytes: int
    free: int

    def __str__(self) -> str:
        hours, minutes = divmod(round(self.seconds / 60), 60)
        took = f"{hours} h {minutes:02} min" if hours else f"{minutes} min" if minutes else f"{self.seconds:.0f} s"
        size = f"{self.bytes / 1e9:,.2f} GB of recordings; {self.free / 1e9:,.1f} GB of disk are free"
        short = "" if self.bytes < self.free else ", which is too little"
        return f"{self.videos:,} videos, {self.frames:,} frames: about {took} and {size}{short}"


def estimate_conversion(jobs: Sequence[Job], out: Path) -> Estimate:
    """What the jobs will take; `out` is the folder that their recordings go to, which needn't exist."""
    lengths = [count for job in _some(jobs, LISTED) if (count := _length(job))]
    frames = round(float(np.mean(lengths)) * len(jobs)) if lengths else 0
    done, took, size = 0, 0.0, 0
    for job in _some(jobs, LOOKED_AT):
        try:
            began = time.monotonic()
            count, written = _piece(job, FRAMES)
        except (OSError, ValueError):
            continue
        done, took, size = done + count, took + time.monotonic() - began, size + written
    each = frames / max(done, 1)
    place = next(parent for parent in (out, *out.absolute().parents) if parent.is_dir())
    return Estimate(len(jobs), frames, took * each, round(size * each), shutil.disk_usage(place).free)


def _length(job: Job) -> int:
    """How many frames of a video are seen, by what its file says; 0 if that can't be known."""
    count, seconds = length_of(job.video.path)
    if not seconds:
        return count
    rate = job.fps or count / seconds
    stop = min(job.view.stop, count / rate)
    return max(0, round((stop - job.view.start) * rate))


def _some(jobs: Sequence[Job], count: int) -> list[Job]:
    return [jobs[n] for n in np.unique(np.linspace(0, len(jobs) - 1, min(count, len(jobs))).astype(int))]


def _piece(job: Job, frames: int) -> tuple[int, int]:
    """Convert the first frames of a video; how many there were, and the bytes of their recording."""
    pieces = list(islice(job.events(), frames))
    with tempfile.TemporaryDirectory(prefix="nvsdata-") as folder:
        target = Path(folder) / job.video.target.name
        formats.write(iter(pieces), target, format=job.video.format)
        return len(pieces), target.stat().st_size
