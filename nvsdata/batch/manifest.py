"""Manifest of a folder of recordings, by which a run resumes: the settings, and a line of JSON per video."""

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
from nvsdata.batch.folder import Video
from nvsdata.common.files import Journal

NAME = "manifest.jsonl"


class Manifest(Journal):
    """Manifest `out/manifest.jsonl`, open for adding lines.

    The first line has the `kind` of the folder, the settings `made` and their hash, the versions of the software, and
    the names of the last run's videos, which show what is missing if that run ends early. Each further line has a
    video's name, status, size, time and sha256, and its result: size and sha256 of the recording, or the reason of a
    failure. If a video was tried twice, its last line counts.

    Args:
        out: Folder of recordings.
        kind: Kind of the folder; the first key of the first line.
        made: Settings that all recordings in the folder must share.
        videos: Names of the run's videos.
        extra: Further entries of the first line, which may differ from run to run.
        name: Name of the file.

    Raises:
        ValueError: The folder's first line has another kind or other settings.
    """

    def __init__(
        self,
        out: Path,
        kind: str,
        made: dict[str, Any],
        videos: Sequence[str],
        extra: dict[str, Any] | None = None,
        name: str = NAME,
    ) -> None:
        # with the types that JSON returns
        made = json.loads(json.dumps(made))
        digest = hashlib.sha256(json.dumps(made, sort_keys=True).encode()).hexdigest()
        tail = {"settings_sha256": digest, "versions": _versions()}
        head = {kind: 1, **made, **(extra or {}), **tail}
        super().__init__(out / name, head)
        if kind in self.head and not self.lines:
            # no video has a line yet, so the first line may be replaced
            self.head, self._torn = head, True
        if kind not in self.head:
            raise ValueError(f"{self.path} is not a manifest of {kind}: choose another folder")
        if self.head["settings_sha256"] != digest:
            was, now = _flat({key: self.head.get(key) for key in made}), _flat(made)
            differs = ", ".join(f"{k} {was.get(k)}, not {v}" for k, v in now.items() if was.get(k) != v)
            raise ValueError(f"{out} has recordings made with {differs}: choose another folder")
        if self.head.get("videos") != list(videos):
            self.head["videos"], self._torn = list(videos), True
        self.videos = {line["video"]: line for line in self.lines}
        self.replaced: dict[str, Path] = {}  # if the run overwrites, the earlier recording of each video

    def has(self, video: Video, statuses: tuple[str, ...], *, check: bool = False) -> bool:
        """Return whether the video is unchanged, has one of the statuses, and has its recording.

        The size of the recording is compared, and with `check` its sha256, too.
        """
        line = self.videos.get(video.name)
        return (
            line is not None
            and line["status"] in statuses
            and _is_same(video.path, line)
            and not recording_fault(video.target, line, check=check)
        )

    def as_before(self, videos: Sequence[Video]) -> list[Video]:
        """Return the videos; if the manifest has a line for a video, `target` is the recording named there."""
        return as_before(videos, list(self.videos.values()), self.path.parent)

    def add(self, line: dict[str, Any]) -> None:
        """Append the line of a video to the manifest."""
        super().add(line)
        self.videos[line["video"]] = line


def recording_fault(recording: Path, line: dict[str, Any], *, check: bool) -> str:
    """Describe how a recording differs from its line of the manifest; empty if it doesn't.

    The size is compared, and with `check` the sha256, too.
    """
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
            return "was changed: its sha256 differs from its manifest's"
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
    """Return the videos; if one of the manifest's `lines` is about a video, `target` is the recording named there.

    Such a recording is in the folder `out`. A video without a line keeps its `target`. Without the lines, a video that
    was added since, such as a.mp4 next to a.avi, would change the names of other videos' recordings.

    Raises:
        ValueError: Two videos would have the same recording.
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
    """Return size, modification time and SHA-256 of a video's file for its line of the manifest.

    Raises:
        OSError: The file can't be read.
    """
    # queried before the content is read, so that a change meanwhile has a later time
    found = video.path.stat()
    return {"bytes": found.st_size, "modified": found.st_mtime_ns, "sha256": sha256(video.path)}


def _is_same(path: Path, line: dict[str, Any]) -> bool:
    """Return whether a video's file is the one in its line: of the same size, and of the same time or content."""
    found = path.stat()
    if found.st_size != line["bytes"]:
        return False
    try:
        return found.st_mtime_ns == line.get("modified") or sha256(path) == line.get("sha256")
    except OSError:
        # the conversion reports why it can't be read
        return False


def _flat(made: dict[str, Any]) -> dict[str, Any]:
    """Return the settings with the entries of the dict "settings" on the same level as the others."""
    return {**(made.get("settings") or {}), **{key: value for key, value in made.items() if key != "settings"}}


def _versions() -> dict[str, str]:
    """Return the versions of the software that recordings depend on."""
    return {
        "nvsdata": __version__,
        "python": platform.python_version(),
        "opencv": cv2.__version__,
        "numpy": np.__version__,
        "h5py": h5py.__version__,
    }


def sha256(path: Path) -> str:
    """Return the SHA-256 of a file's content, in hexadecimal digits."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
