"""What a folder of recordings was made of: settings, and a JSON line per video."""

from __future__ import annotations

import hashlib
import json
import platform
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cv2
import h5py
import numpy as np

from nvsdata._version import __version__
from nvsdata.common.files import Journal

NAME = "manifest.jsonl"


class Manifest(Journal):
    """`out/manifest.jsonl`, open for adding lines.

    The first line has the `kind` of the folder, what its recordings are `made` with, a hash of that, and the versions
    of the software. Each further line has a video's name, status, size and sha256, and what came of it. A video that
    was tried twice has two lines; the last one counts.

    - `out`: the folder of recordings
    - `kind`: of the folder; the first key of the first line
    - `made`: settings that all recordings in the folder must share
    - `told`: what the first line also has, and may differ from run to run (default: nothing)

    ValueError if the folder's first line has another kind or other settings.
    """

    def __init__(self, out: Path, kind: str, made: dict[str, Any], told: dict[str, Any] | None = None) -> None:
        # as the file would give it back
        made = json.loads(json.dumps(made))
        digest = hashlib.sha256(json.dumps(made, sort_keys=True).encode()).hexdigest()
        tail = {"settings_sha256": digest, "versions": _versions()}
        head = {kind: 1, **made, **(told or {}), **tail}
        super().__init__(out / NAME, head)
        if kind in self.head and not self.lines:
            # no video has a line yet, so the first line may be replaced
            self.head, self._torn = head, True
        if kind not in self.head:
            raise ValueError(f"{self.path} is not a manifest of {kind}: choose another folder")
        if self.head["settings_sha256"] != digest:
            was, now = _flat({key: self.head.get(key) for key in made}), _flat(made)
            differs = ", ".join(f"{k} {was.get(k)}, not {v}" for k, v in now.items() if was.get(k) != v)
            raise ValueError(f"{out} holds recordings made with {differs}: choose another folder")
        self.videos = {line["video"]: line for line in self.lines}

    def has(self, name: str, video: Path, target: Path, statuses: tuple[str, ...]) -> bool:
        """Whether the video, unchanged since, has one of these statuses, and its recording is there."""
        line = self.videos.get(name)
        return (
            line is not None
            and line["status"] in statuses
            and line["bytes"] == video.stat().st_size
            and target.exists()
            and target.stat().st_size == line["recording"]
        )

    def add(self, line: dict[str, Any]) -> None:
        super().add(line)
        self.videos[line["video"]] = line


@dataclass
class FolderReport:
    """What a run did with a folder of videos.

    - `done`: recordings that it made
    - `kept`: recordings that were there already
    - `events`: in the recordings that it made
    - `failed`: why videos failed, by their names
    """

    done: int = 0
    kept: int = 0
    events: int = 0
    failed: dict[str, str] = field(default_factory=dict)

    def count(self, line: dict[str, Any], good: tuple[str, ...]) -> None:
        """Count a line of the manifest, whose recording was made if its status is one of the `good`."""
        self.events += line.get("events", 0)
        self.done += line["status"] in good
        if "reason" in line:
            self.failed[line["video"]] = line["reason"]


def _flat(made: dict[str, Any]) -> dict[str, Any]:
    """Settings with those inside "settings" beside the others."""
    return {**made.get("settings", {}), **{key: value for key, value in made.items() if key != "settings"}}


def _versions() -> dict[str, str]:
    return {
        "nvsdata": __version__,
        "python": platform.python_version(),
        "opencv": cv2.__version__,
        "numpy": np.__version__,
        "h5py": h5py.__version__,
    }
