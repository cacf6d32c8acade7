"""What a folder of recordings was made of: settings, and a JSON line per video."""

from __future__ import annotations

import hashlib
import json
import logging
import os
import platform
import stat
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Self

import cv2
import h5py
import numpy as np

from nvsdata._version import __version__
from nvsdata.common.errors import shown
from nvsdata.common.files import Journal
from nvsdata.common.progress import bar
from nvsdata.common.terminal import say
from nvsdata.video.decoder_errors import DecoderErrors
from nvsdata.video.folder import Video, fatal, sha256

NAME = "manifest.jsonl"
log = logging.getLogger(__name__)


class Manifest(Journal):
    """`out/manifest.jsonl`, open for adding lines.

    The first line has the `kind` of the folder, what its recordings are `made` with, a hash of that, the versions of
    the software, and the names of the last run's videos, so that it is known what is missing if that run ends early.
    Each further line has a video's name, status, size, time and sha256, and what came of it: the size and sha256 of its
    recording, or why it failed. A video that was tried twice has two lines; the last one counts.

    - `out`: the folder of recordings
    - `kind`: of the folder; the first key of the first line
    - `made`: settings that all recordings in the folder must share
    - `videos`: names of the run's videos
    - `told`: what the first line also has, and may differ from run to run (default: nothing)
    - `name`: of the file (default "manifest.jsonl")

    ValueError if the folder's first line has another kind or other settings.
    """

    def __init__(
        self,
        out: Path,
        kind: str,
        made: dict[str, Any],
        videos: Sequence[str],
        told: dict[str, Any] | None = None,
        name: str = NAME,
    ) -> None:
        # as the file would give it back
        made = json.loads(json.dumps(made))
        digest = hashlib.sha256(json.dumps(made, sort_keys=True).encode()).hexdigest()
        tail = {"settings_sha256": digest, "versions": _versions()}
        head = {kind: 1, **made, **(told or {}), **tail}
        super().__init__(out / name, head)
        if kind in self.head and not self.lines:
            # no video has a line yet, so the first line may be replaced
            self.head, self._torn = head, True
        if kind not in self.head:
            raise ValueError(f"{self.path} is not a manifest of {kind}: choose another folder")
        if self.head["settings_sha256"] != digest:
            was, now = _flat({key: self.head.get(key) for key in made}), _flat(made)
            differs = ", ".join(f"{k} {was.get(k)}, not {v}" for k, v in now.items() if was.get(k) != v)
            raise ValueError(f"{out} holds recordings made with {differs}: choose another folder")
        if self.head.get("videos") != list(videos):
            self.head["videos"], self._torn = list(videos), True
        self.videos = {line["video"]: line for line in self.lines}
        self.replaced: dict[str, Path] = {}  # recordings that a run which overwrites them found

    def has(self, video: Video, statuses: tuple[str, ...], *, check: bool = False) -> bool:
        """Whether the video, unchanged since, has one of these statuses, and its recording is there.

        The size of the recording is compared and, to `check` it, also its sha256.
        """
        line = self.videos.get(video.name)
        return (
            line is not None
            and line["status"] in statuses
            and _is_same(video.path, line)
            and not fault_of(video.target, line, check=check)
        )

    def as_before(self, videos: Sequence[Video]) -> list[Video]:
        """The videos, each with the recording that it had before; see `as_before`."""
        return as_before(videos, list(self.videos.values()), self.path.parent)

    def add(self, line: dict[str, Any]) -> None:
        super().add(line)
        self.videos[line["video"]] = line


def fault_of(recording: Path, line: dict[str, Any], *, check: bool) -> str:
    """Return how a recording differs from its line of the manifest: in size or, to `check`, in sha256; empty if not."""
    try:
        status = recording.stat()
        if not stat.S_ISREG(status.st_mode):
            return "isn't a file"
        size = status.st_size
        if size != line["recording"]:
            stated = line["recording"]
            stated = f"{stated:,}" if isinstance(stated, int) else repr(stated)
            return f"has {size:,} bytes, not the {stated} of its manifest"
        if check and "recording_sha256" not in line:
            return "can't be compared: its manifest has no sha256 of it"
        if check and sha256(recording) != line["recording_sha256"]:
            return "was changed since it was made: its sha256 is another than in its manifest"
    except (FileNotFoundError, NotADirectoryError):
        return "is missing"
    except (OSError, ValueError) as error:
        # such as a name that no file can have
        return f"can't be read: {error}"
    return ""


def files_of(lines: Sequence[dict[str, Any]], out: Path) -> dict[str, Path]:
    """Return the recording of each video, by the videos' names. ValueError for one outside the folder `out`."""
    found = {line["video"]: out / line["file"] for line in lines if "file" in line}
    for video, path in found.items():
        if not Path(os.path.abspath(path)).is_relative_to(os.path.abspath(out)):
            raise ValueError(f"the manifest of {out} names a recording of {video} outside the folder: {path}")
    return found


def as_before(videos: Sequence[Video], lines: Sequence[dict[str, Any]], out: Path) -> list[Video]:
    """The videos, each with the recording in `out` that lines of the manifest name: a video that was added since, such
    as a.mp4 beside a.avi, would give others new names.

    ValueError if two would have the same recording.
    """
    known = files_of(lines, out)
    found = [video._replace(target=known.get(video.name, video.target)) for video in videos]
    whose: dict[Path, str] = {}
    for video in found:
        other = whose.setdefault(video.target, video.name)
        if other != video.name:
            raise ValueError(f"{video.name} and {other} would both be recorded to {video.target}: rename one of them")
    return found


@dataclass
class FolderReport:
    """What a run did with a folder of videos.

    - `done`: recordings that it made
    - `kept`: recordings that were there already
    - `events`: in the recordings that it made
    - `failed`: why videos failed, by their names
    - `damaged`: errors that FFmpeg found in videos whose recordings were made all the same, by their names
    - `without_preview`: why films that were asked for can't be made, by the videos' names
    - `kept_events`: in the recordings that were there already
    """

    done: int = 0
    kept: int = 0
    events: int = 0
    failed: dict[str, str] = field(default_factory=dict)
    damaged: dict[str, int] = field(default_factory=dict)
    without_preview: dict[str, str] = field(default_factory=dict)
    kept_events: int = 0

    def count(self, line: dict[str, Any], good: tuple[str, ...]) -> None:
        """Count a line of the manifest, whose recording was made if its status is one of the `good`."""
        self.events += line.get("events", 0)
        self.done += line["status"] in good
        if "reason" in line:
            self.failed[line["video"]] = line["reason"]
        elif "decoder_errors" in line:
            self.damaged[line["video"]] = line["decoder_errors"]

    @property
    def total(self) -> str:
        """All recordings of the run's videos, in words."""
        return f"{self.done + self.kept:,} recordings with {self.events + self.kept_events:,} events"

    def told(self) -> list[str]:
        """A line for each video that failed, is damaged, or has no preview."""
        damaged = "its stream is damaged, pictures may be smeared: {:,} errors of the decoder"
        return [
            *(shown(f"{name}: {reason}") for name, reason in self.failed.items()),
            *(shown(f"{name}: {damaged.format(count)}") for name, count in self.damaged.items()),
            *(shown(f"{name}: no preview: {reason}") for name, reason in self.without_preview.items()),
        ]


class FolderRun:
    """A run over a folder of videos: which are left to do, and what became of each; use it in a `with` block.

    - `manifest`: gets a line for each video that is done
    - `videos`: all of the folder
    - `done`: statuses of lines whose recordings were made
    - `what`: is being done, for the progress bar
    - `resume`: what the user does after a run that ended early (default: runs the same command)
    - `check`: whether the recordings that are there are compared with their sha256 (default False)

    `waiting` are the videos that the manifest doesn't call done, `report` counts. If the block raises, a line on
    stderr says how many videos are done.
    """

    def __init__(
        self,
        manifest: Manifest,
        videos: Sequence[Video],
        done: tuple[str, ...],
        what: str,
        *,
        resume: str = "the same command resumes",
        check: bool = False,
    ) -> None:
        self._manifest, self._done, self._resume, self._total = manifest, done, resume, len(videos)
        looked_at = bar(videos, "checking", shown=check, leave=False)
        kept = [video for video in looked_at if manifest.has(video, done, check=check)]
        there = set(kept)
        self.waiting = [video for video in videos if video not in there]
        events = sum(manifest.videos[video.name].get("events", 0) for video in kept)
        self.report = FolderReport(kept=len(kept), kept_events=events)
        self.bar = bar(None, what, total=len(self.waiting), unit="video")
        self._started, self._count = time.monotonic(), 0
        self._targets = {video.target for video in videos}
        self._files = {video.name: video.target.relative_to(manifest.path.parent).as_posix() for video in videos}

    def add(self, line: dict[str, Any]) -> str:
        """Keep the line of a video that is done, or that failed; returns its recording's name below the folder."""
        line = {"video": line["video"], "file": self._files[line["video"]]} | line
        self._manifest.add(line)
        old = self._manifest.replaced.pop(line["video"], None)
        if line["status"] in self._done and old is not None and old not in self._targets:
            # it had another name, or was of another format
            old.unlink(missing_ok=True)
        self.report.count(line, self._done)
        seconds = max(time.monotonic() - self._started, 1e-3)
        self.bar.set_postfix_str(f"{self.report.events / seconds:,.0f} events/s", refresh=False)
        self._count += 1
        self.bar.update(self._count - self.bar.n)
        told = f"{line.get('events', 0):,} events" if "reason" not in line else line["reason"]
        log.info("%s: %s, %s", shown(line["video"]), shown(line["status"]), shown(told))
        return str(line["file"])

    def within(self, share: float) -> None:
        """So much of the present video is done, from 0 to 1."""
        self.bar.update(round(self._count + min(share, 0.99), 2) - self.bar.n)

    def doing(self, what: str) -> None:
        """Show what is being done, and the time."""
        self.bar.set_postfix_str(what, refresh=False)
        self.bar.refresh()

    def again(self, video: Video) -> None:
        """A video that failed isn't done yet after all."""
        self.report.failed.pop(video.name, None)
        self._count -= 1
        self.bar.update(-1)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        self.bar.close()
        if kind is not None:
            say(f"{self.report.done + self.report.kept:,} of {self._total:,} videos are done: {self._resume}")


def file_facts(video: Video) -> dict[str, Any]:
    """What a video's line says about its file. OSError if it can't be read."""
    # before its content: what changes meanwhile has a later time than this
    found = video.path.stat()
    return {"bytes": found.st_size, "modified": found.st_mtime_ns, "sha256": sha256(video.path)}


@contextmanager
def noted(video: Video, line: dict[str, Any], fatal_too: tuple[type[Exception], ...] = ()) -> Iterator[None]:
    """While the block makes a video's recording, from reading its file on: put into `line` why it failed if it did, and
    how many errors the decoder found in it.

    Errors that the next video would have, too, are raised: those of the disk, and `fatal_too` (default: none more).
    """
    with DecoderErrors() as errors:
        try:
            yield
        except fatal_too:
            raise
        except (ValueError, OSError, cv2.error, MemoryError) as error:
            if isinstance(error, OSError) and fatal(error, video.path):
                raise
            line |= {"status": "failed", "reason": str(error)}
    if errors.found:
        line |= {"decoder_errors": errors.found}


def _is_same(path: Path, line: dict[str, Any]) -> bool:
    """Whether a video's file is the one of its line: by size and time, or by content where that time is another."""
    found = path.stat()
    if found.st_size != line["bytes"]:
        return False
    try:
        return found.st_mtime_ns == line.get("modified") or sha256(path) == line.get("sha256")
    except OSError:
        # why it can't be read is told when it is converted
        return False


def _flat(made: dict[str, Any]) -> dict[str, Any]:
    """Settings with those inside "settings" beside the others."""
    return {**(made.get("settings") or {}), **{key: value for key, value in made.items() if key != "settings"}}


def _versions() -> dict[str, str]:
    return {
        "nvsdata": __version__,
        "python": platform.python_version(),
        "opencv": cv2.__version__,
        "numpy": np.__version__,
        "h5py": h5py.__version__,
    }
