"""Conversion of folders of videos to folders of recordings, which `EventFolder` reads."""

from __future__ import annotations

import os
from contextlib import closing, suppress
from dataclasses import asdict, replace
from functools import partial
from math import inf
from pathlib import Path

from nvsdata.batch.folder import videos_in
from nvsdata.batch.run import FolderReport, FolderRun
from nvsdata.batch.scheduler import as_done, in_shard
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
    """Convert a video, or every video in a folder and its subfolders, to recordings.

    Recordings are in the same subfolders as their videos, so class folders stay class folders. `out/manifest.jsonl`
    has the settings and a line per video. After an interruption, the next call resumes and repeats failed videos. A
    damaged video is reported, and the others are converted. A truncated video is converted as far as possible, and
    counts as failed.

    Args:
        source: A video, or a folder of videos.
        out: Folder of the recordings (default: next to the source, with its name and "-events").
        settings: The emulator (default: `PIX2NVS()`).
        format: Format of the recordings: "hdf5", "hdf5-gzip" (a third of the size), "aedat2", "aedat3", "aedat4" or
            "text".
        size: (width, height) in pixels that frames are scaled to (default: unchanged).
        fps: Frames per second, in place of the files' own times.
        jobs: Number of processes.
        view: Part of each video, and how its frames are fitted to `size` (default: all of it, padded with black).
        limit: Number of videos to convert, the first ones in order of path (default: all).
        scheduler: Address of a Dask cluster that converts the videos in place of local processes. It needs
            `nvsdata[distributed]`, and its workers must have both folders under the same paths.
        shard: (i, n), with i from 1 to n: convert every n-th video from the i-th on. Processes of different shards may
            write to the same folder at the same time. Each has its own manifest, and the next run without shards joins
            them.
        overwrite: Convert all videos again, also if the folder has recordings of other settings.
        check: Compare existing recordings with the sha256 in the manifest, and convert again those that changed
            (default: compare sizes only).
        preview: Write a film of each video's first minute with its events to `out/.previews`, unless there is one.

    Returns:
        A `FolderReport` with the numbers of recordings and events, and the reasons of failures.

    Raises:
        FileNotFoundError: There is no video.
        ValueError: The folder has recordings of other settings, or frames are larger than any AEDAT 2 sensor.
        OSError: Nothing can be written to `out`.

    Example:
        >>> import tempfile, cv2, numpy as np
        >>> folder = tempfile.mkdtemp()
        >>> writer = cv2.VideoWriter(f"{folder}/a.avi", cv2.VideoWriter.fourcc(*"MJPG"), 25, (64, 48))
        >>> _ = [writer.write(np.full((48, 64, 3), gray, np.uint8)) for gray in (50, 100, 200)]
        >>> writer.release()
        >>> convert_videos(f"{folder}/a.avi", f"{folder}/out").done
        1
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
    """Remove the preview films of a new recording and of the one that it replaces."""
    for recording in (new,) if old is None else (new, old):
        # a film that can't be removed is older than the recording, and will be replaced
        with suppress(OSError):
            preview_of(recording, out).unlink()


def _preview(jobs: list[Job], out: Path, processes: int, scheduler: str | None) -> dict[str, str]:
    """Make the missing preview films; return the reason of each failure by video name."""
    missing = [job for job in jobs if _age(preview_of(job.video.target, out)) < _age(job.video.target)]
    with (
        bar(None, "previews", total=len(missing), unit="video") as shown,
        closing(as_done(partial(_film, out=out), missing, processes, scheduler)) as results,
    ):
        failed = {}
        for name, reason in results:
            shown.update()
            if reason:
                failed[name] = reason
    return failed


def _age(path: Path) -> float:
    """Return the time of a file's last change; minus infinity if there is no file."""
    try:
        return path.stat().st_mtime
    except OSError:
        return -inf


def _film(job: Job, out: Path) -> tuple[str, str]:
    """Make a preview film; return the video's name and the reason of a failure, "" for success."""
    return job.video.name, save_preview(job, preview_of(job.video.target, out))


def default_out(source: str | os.PathLike[str]) -> Path:
    """Return the default folder of the recordings."""
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
    """Return the jobs of `convert_videos` with the same parameters; nothing is written."""
    target = Path(out or default_out(source))
    videos = videos_in(Path(source), target, format, limit)
    jobs = [Job(video, settings, size, fps, view) for video in in_shard(videos, shard)]
    if format == "aedat2":
        _check_chip(jobs)
    return jobs


def _check_chip(jobs: list[Job]) -> None:
    """Raise ValueError if the frames of the first readable video are larger than any AEDAT 2 sensor."""
    size: tuple[int, int] | None = None
    for job in jobs:
        size = job.size
        # the conversion reports videos that can't be read
        with suppress(OSError, ValueError):
            frames = frames_of(job.video.path, view=job.view)
            height, width = next(frames).pixels.shape[:2]
            size = size or (width, height)
        if size is not None:
            chip_for(*size)
            return
