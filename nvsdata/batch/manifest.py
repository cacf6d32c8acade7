"""Manifests of folders of recordings: the settings, and a JSON line per video."""

from __future__ import annotations

import hashlib
import json
import os
import platform
import stat
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import h5py
import numpy as np

from nvsdata._version import __version__
from nvsdata.batch.folder import Video, sha256
from nvsdata.common.files import Journal

NAME = "manifest.jsonl"


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
            and not recording_fault(video.target, line, check=check)
        )

    def as_before(self, videos: Sequence[Video]) -> list[Video]:
        """The videos, each with the recording that it had before; see `as_before`."""
        return as_before(videos, list(self.videos.values()), self.path.parent)

    def add(self, line: dict[str, Any]) -> None:
        super().add(line)
        self.videos[line["video"]] = line


def recording_fault(recording: Path, line: dict[str, Any], *, check: bool) -> str:
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


def file_facts(video: Video) -> dict[str, Any]:
    """What a video's line says about its file. OSError if it can't be read."""
    # before its content: what changes meanwhile has a later time than this
    found = video.path.stat()
    return {"bytes": found.st_size, "modified": found.st_mtime_ns, "sha256": sha256(video.path)}


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
