"""Estimate of the time and disk space of a conversion, from the first frames of a few of its videos."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Sequence
from itertools import islice
from pathlib import Path

import numpy as np

from nvsdata import formats
from nvsdata.batch.estimate import Estimate, evenly_spaced
from nvsdata.emulation.job import Job
from nvsdata.video.decoder import length_of

SAMPLES = 5  # videos of which the first frames are converted
LISTED = 200  # videos whose length is read; the others are assumed to be alike
FRAMES = 60  # frames that are converted of each sample


def estimate_conversion(jobs: Sequence[Job], out: Path, processes: int = 1) -> Estimate:
    """Return the time and disk space that the jobs will need.

    Args:
        jobs: Videos to convert.
        out: Folder of the recordings, which need not exist yet.
        processes: Number of processes that will work at the same time.
    """
    lengths = [count for job in evenly_spaced(jobs, LISTED) if (count := _length(job))]
    frames = round(float(np.mean(lengths)) * len(jobs)) if lengths else 0
    done, seconds, size = 0, 0.0, 0
    for job in evenly_spaced(jobs, SAMPLES):
        try:
            began = time.monotonic()
            count, written = _convert_beginning(job)
        except (OSError, ValueError):
            continue
        done, seconds, size = done + count, seconds + time.monotonic() - began, size + written
    each = frames / max(done, 1)
    seconds *= each / max(1, min(processes, len(jobs)))
    return Estimate.on_disk(out, len(jobs), seconds, round(size * each), frames=frames)


def _length(job: Job) -> int:
    """Return the number of frames in the converted part of a video, computed from the file's header; 0 if unknown."""
    count, seconds = length_of(job.video.path)
    if not seconds:
        return count
    rate = job.fps or count / seconds
    stop = min(job.view.stop, count / rate)
    return max(0, round((stop - job.view.start) * rate))


def _convert_beginning(job: Job) -> tuple[int, int]:
    """Convert the first `FRAMES` frames of a video; return their number and the bytes of their recording."""
    pieces = list(islice(job.events(), FRAMES))
    with tempfile.TemporaryDirectory(prefix="nvsdata-") as folder:
        target = Path(folder) / job.video.target.name
        formats.write(iter(pieces), target, format=job.video.format)
        return len(pieces), target.stat().st_size
