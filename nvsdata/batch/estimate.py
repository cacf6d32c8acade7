"""Estimate of the time and disk space that a run over a folder of videos needs."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Self, TypeVar

import numpy as np

Item = TypeVar("Item")


@dataclass(frozen=True)
class Estimate:
    """Time and disk space that a run will need, approximately. `str` returns the estimate as a sentence.

    Args:
        videos: Number of videos.
        seconds: Time of the run in s.
        bytes: Size of the recordings in bytes.
        free: Bytes of disk that are free.
        frames: Number of frames of all videos, or None if not estimated.
        reserve: Bytes that must stay free.
    """

    videos: int
    seconds: float
    bytes: int
    free: int
    frames: int | None = None
    reserve: int = 0

    @classmethod
    def on_disk(
        cls, out: Path, videos: int, seconds: float, bytes: int, *, frames: int | None = None, reserve: int = 0
    ) -> Self:
        """Return an estimate with the free space of the disk of the folder `out`, which need not exist yet."""
        place = next(parent for parent in (out, *out.absolute().parents) if parent.is_dir())
        return cls(videos, seconds, bytes, shutil.disk_usage(place).free, frames, reserve)

    @property
    def short(self) -> bool:
        """True if the disk is too small."""
        return self.videos > 0 and self.bytes + self.reserve > self.free

    def __str__(self) -> str:
        hours, minutes = divmod(round(self.seconds / 60), 60)
        time = f"{hours} h {minutes:02} min" if hours else f"{minutes} min" if minutes else f"{self.seconds:.0f} s"
        frames = "" if self.frames is None else f", {self.frames:,} frames"
        size = f"{self.bytes / 1e9:,.2f} GB of recordings; {self.free / 1e9:,.1f} GB of disk are free"
        return f"{self.videos:,} videos{frames}: about {time} and {size}{', which is too little' if self.short else ''}"


def evenly_spaced(items: Sequence[Item], count: int) -> list[Item]:
    """Return at most `count` evenly spaced items, including the first and the last."""
    return [items[n] for n in np.unique(np.linspace(0, len(items) - 1, min(count, len(items))).astype(int))]
