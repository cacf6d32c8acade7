"""What a folder of converted videos was made of: its settings, and a JSON line a video."""

from __future__ import annotations

import hashlib
import json
import platform
from dataclasses import asdict
from pathlib import Path
from typing import Any

import cv2
import h5py
import numpy as np

import nvsdata
from nvsdata.emulation.pix2nvs import PIX2NVS
from nvsdata.files import Journal

NAME = "manifest.jsonl"


class Manifest(Journal):
    """`out/manifest.jsonl`, open for adding lines.

    The first line has the settings, their hash and the versions of what made the recordings; each
    further line a video's name, status, size and sha256, and the frames and events it gave. A video
    that was tried twice has two lines; the last one holds. ValueError if the folder's first line tells
    of other settings.
    """

    def __init__(
        self, out: Path, settings: PIX2NVS, *, format: str, size: tuple[int, int] | None, fps: float | None
    ) -> None:
        made: dict[str, Any] = {
            "settings": asdict(settings),
            "format": format,
            "size": list(size) if size else None,
            "fps": fps,
        }
        digest = hashlib.sha256(json.dumps(made, sort_keys=True).encode()).hexdigest()
        super().__init__(out / NAME, {"nvsdata-videos": 1, **made, "settings_sha256": digest, "versions": _versions()})
        if "settings_sha256" not in self.head:
            raise ValueError(f"{self.path} is no manifest of converted videos: choose another folder")
        if self.head["settings_sha256"] != digest:
            was, now = ({**d["settings"], **{k: d[k] for k in ("format", "size", "fps")}} for d in (self.head, made))
            differs = ", ".join(f"{k} {was.get(k)}, not {v}" for k, v in now.items() if was.get(k) != v)
            raise ValueError(f"{out} holds recordings made with {differs}: choose another folder")
        self._videos = {line["video"]: line for line in self.lines}

    def has(self, name: str, video: Path, target: Path) -> bool:
        """Whether the video, as it is now, has been converted and its recording is there."""
        line = self._videos.get(name)
        return (
            line is not None
            and line["status"] == "converted"
            and line["bytes"] == video.stat().st_size
            and target.exists()
            and target.stat().st_size == line["recording"]
        )


def _versions() -> dict[str, str]:
    return {
        "nvsdata": nvsdata.__version__,
        "python": platform.python_version(),
        "opencv": cv2.__version__,
        "numpy": np.__version__,
        "h5py": h5py.__version__,
    }
