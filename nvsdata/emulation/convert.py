"""Conversion of folders of videos to folders of recordings that `EventFolder` reads."""

from __future__ import annotations

import os
from contextlib import closing, suppress
from dataclasses import asdict, replace
from functools import partial
from math import inf
from pathlib import Path

from nvsdata.batch.folder import videos_in
from nvsdata.batch.run import FolderReport, FolderRun
from nvsdata.batch.scheduler import as_done
from nvsdata.batch.shards import open_manifest
from nvsdata.common.progress import bar
from nvsdata.emulation.job import Job, convert
from nvsdata.emulation.pix2nvs import PIX2NVS
from nvsdata.emulation.preview import preview_of, save_preview
from nvsdata.emulation.protocol import EventEmulator, describe_settings
from nvsdata.formats.aedat.aedat2 import chip_for
from nvsdata.video.frames import frames_of
from nvsdata.video.view import WHOLE_VIDEO, VideoView

KIND = "nvsdata-videos"
DONE = ("converted",)
WITH_FILMS = (*DONE, "truncated")


def convert_videos(
    source: str | os.PathLike[str],
    out: str | os.PathLike[str] | None = None,
    settings: EventEmulator | None = None,
    *,
    format: str = "hdf5",
    size: tuple[int, int] | None = None,
    fps: float | None = None,
    jobs: int = 1,
    view: VideoView = WHOLE_VIDEO,
    limit: int | None = None,
    scheduler: str | None = None,
    shard: tuple[int, int] | None = None,
    overwrite: bool = False,
    check: bool = False,
    preview: bool = False,
) -> FolderReport:
    """Convert a video, or every video below a folder, to recordings.

    The tree of folders is kept, so class folders stay class folders. `out/manifest.jsonl` has the settings and a line
    per video. A run that was stopped goes on where it was, and tries again what had failed. A broken video is
    reported and the rest goes on. A video that is cut off is converted as far as it goes, and counts as failed.

    - `source`: a video, or a folder of videos
    - `out`: the folder that recordings go to (default: the source's name and "-events", beside it)
    - `settings`: the emulator (default: `PIX2NVS()`)
    - `format`: of the recordings, "hdf5", "hdf5-gzip" (a third of the disk), "aedat2", "aedat3", "aedat4" or "text"
      (default "hdf5")
    - `size`: (width, height) in pixels that frames are scaled to (default: as they are)
    - `fps`: frames per second, whatever the files say (default: as they say)
    - `view`: which part of each video, and how its frames come into `size` (default: all of it; whole, with black
      beside them, where the shape is another)
    - `jobs`: processes that work at once (default 1)
    - `limit`: convert the first N videos only (default: all)
    - `scheduler`: address of a Dask cluster whose workers convert instead (needs `nvsdata[distributed]`; the workers
      must see both folders under the same names)
    - `shard`: (i, n): every n-th video from the i-th on, i from 1 to n. Processes that do different shards may write to
      the same folder at once; each has a manifest of its own there, and the next run without shards joins them
      (default: all videos)
    - `overwrite`: convert all videos anew, also if the folder holds recordings of other settings (default False)
    - `check`: compare the recordings that are there with the sha256 in the manifest, and convert again what was changed
      (default False: by size only)
    - `preview`: write a film of each video's first minute with its events to `out/.previews`, where there is none yet
      (default False)

    Raises FileNotFoundError if there is no video, ValueError for a folder that holds recordings of
    other settings, and for frames larger than any chip of AEDAT 2, and OSError if nothing can be written there.
    """
    found = plan(
        source, out, settings or PIX2NVS(), format=format, size=size, fps=fps, view=view, limit=limit, shard=shard
    )
    target = Path(out or default_out(source))
    target.mkdir(parents=True, exist_ok=True)
    made = {"settings": describe_settings(settings or PIX2NVS()), "format": format, "size": size, "fps": fps}
    if view != WHOLE_VIDEO:
        made["view"] = {name: value for name, value in asdict(view).items() if value != getattr(WHOLE_VIDEO, name)}
    names = [job.video.name for job in found]
    with open_manifest(target, KIND, made, names, shard=shard, overwrite=overwrite) as manifest:
        before = manifest.as_before([job.video for job in found])
        videos = {video: replace(job, video=video) for video, job in zip(before, found, strict=True)}
        with FolderRun(manifest, list(videos), DONE, "converting", check=check) as run:
            waiting = [videos[video] for video in run.waiting]
            alone = scheduler is None and (jobs == 1 or len(waiting) < 2)
            work = partial(convert, progress=run.within) if alone else convert
            with closing(as_done(work, waiting, jobs, scheduler)) as results:
                for line in results:
                    _drop_films(manifest.replaced.get(line["video"]), target / run.add(line), target)
        if preview:
            made_there = [job for job in videos.values() if manifest.has(job.video, WITH_FILMS)]
            run.report.without_preview |= _preview(made_there, target, jobs, scheduler)
    return run.report


def _drop_films(old: Path | None, new: Path, out: Path) -> None:
    """Remove the film of a recording that was made anew, and of the one that it took the place of."""
    for recording in (new,) if old is None else (new, old):
        # if it can't be removed, it is older than the recording, and made anew
        with suppress(OSError):
            preview_of(recording, out).unlink()


def _preview(jobs: list[Job], out: Path, processes: int, scheduler: str | None) -> dict[str, str]:
    """Make the films that aren't there; returns why some can't be made, by the videos' names."""
    lacking = [job for job in jobs if _age(preview_of(job.video.target, out)) < _age(job.video.target)]
    with (
        bar(None, "previews", total=len(lacking), unit="video") as shown,
        closing(as_done(partial(_film, out=out), lacking, processes, scheduler)) as results,
    ):
        failed = {}
        for name, reason in results:
            shown.update()
            if reason:
                failed[name] = reason
    return failed


def _age(path: Path) -> float:
    """When a file was changed; before all others if there is none."""
    try:
        return path.stat().st_mtime
    except OSError:
        return -inf


def _film(job: Job, out: Path) -> tuple[str, str]:
    """The name of a video, and why it has no film; empty if it has one now."""
    return job.video.name, save_preview(job, preview_of(job.video.target, out))


def default_out(source: str | os.PathLike[str]) -> Path:
    """The folder that recordings go to if none is given."""
    whole = Path(source).resolve()
    return whole.with_name(f"{whole.name if whole.is_dir() else whole.stem}-events")


def plan(
    source: str | os.PathLike[str],
    out: str | os.PathLike[str] | None,
    settings: EventEmulator,
    *,
    format: str = "hdf5",
    size: tuple[int, int] | None = None,
    fps: float | None = None,
    view: VideoView = WHOLE_VIDEO,
    limit: int | None = None,
    shard: tuple[int, int] | None = None,
) -> list[Job]:
    """The jobs that `convert_videos` would do with the same parameters; nothing is written."""
    target = Path(out or default_out(source))
    videos = videos_in(Path(source), target, format, limit)
    first, step = (0, 1) if shard is None else (shard[0] - 1, shard[1])
    if not (step >= 1 and 0 <= first < step):
        raise ValueError(f"shard must be (i, n) with 1 <= i <= n, not {shard}")
    jobs = [Job(video, settings, size, fps, view) for video in videos[first::step]]
    if format == "aedat2":
        _check_chip(jobs)
    return jobs


def _check_chip(jobs: list[Job]) -> None:
    """ValueError if no chip of AEDAT 2 is as large as what the jobs' first readable video becomes."""
    size: tuple[int, int] | None = None
    for job in jobs:
        size = job.size
        # what can't be read is told when its turn comes
        with suppress(OSError, ValueError):
            frames = frames_of(job.video.path, view=job.view)
            height, width = next(frames).pixels.shape[:2]
            size = size or (width, height)
        if size is not None:
            chip_for(*size)
            return
