"""Any folder of recordings."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

from nvsdata import formats
from nvsdata.datasets.base import EventDataset, Info, Sample, Transform, recordings_in
from nvsdata.events import Recording


class EventFolder(EventDataset):
    """A folder of class folders of recordings, in any known format (as torchvision's ImageFolder).

    `split` "all" takes the class folders of `root` itself, "train" and "test" those of
    `root/train` and `root/test`. The classes are the sorted folder names. `sensor_size` applies to
    every recording; by default each states its own, and the dataset that of its first.

    FileNotFoundError if there is no such folder, no class folder in it, or no recording.
    """

    info = Info(name="folder", sensor_size=None, classes=(), page="your own files", licence="your own")
    splits = ("all", "train", "test")

    def __init__(
        self,
        root: str | os.PathLike[str],
        split: str = "all",
        *,
        sensor_size: tuple[int, int] | None = None,
        transform: Transform | None = None,
        target_transform: Transform | None = None,
    ) -> None:
        self._given_size = sensor_size
        super().__init__(root, split, transform=transform, target_transform=target_transform)
        self._size = sensor_size or formats.open(self.samples[0].path).sensor_size

    @property
    def sensor_size(self) -> tuple[int, int] | None:
        return self._size

    @property
    def _home(self) -> Path:
        return self.root if self.split == "all" else self.root / self.split

    def _classes(self) -> list[str]:
        if not self._home.is_dir():
            raise FileNotFoundError(f"{self._home} is no folder; split={self.split!r} needs it")
        names = sorted(p.name for p in self._home.iterdir() if p.is_dir() and not p.name.startswith("."))
        if not names:
            raise FileNotFoundError(
                f"no class folders in {self._home}: put each class's recordings in a folder of its name"
            )
        return names

    def _samples(self) -> Iterator[Sample]:
        for label, name in enumerate(self.classes):
            for path in recordings_in(self._home / name):
                yield Sample(path, label)

    def _open(self, path: Path) -> Recording:
        return formats.open(path, sensor_size=self._given_size)

    def _how_to_get(self) -> str:
        return f"it needs class folders with recordings ({', '.join(formats.suffixes())})"
