"""Any folder of recordings."""

from __future__ import annotations

import os
from collections.abc import Iterable
from typing import Any

from nvsdata import formats
from nvsdata.datasets.base import EventDataset, Info, Sample
from nvsdata.datasets.source import recordings_in


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
        **options: Any,
    ) -> None:
        self._size = sensor_size
        super().__init__(root, split, **options)
        self._first_size = sensor_size or self.source.open(self.samples[0].name, None).sensor_size

    @property
    def sensor_size(self) -> tuple[int, int] | None:
        return self._first_size

    @property
    def opened_with(self) -> tuple[int, int] | None:
        return self._size

    def _classes(self) -> list[str]:
        home = "" if self.split == "all" else self.split + "/"
        if home and not any(folder == self.split or folder.startswith(home) for folder in self.listing):
            raise FileNotFoundError(f"{self.root / self.split} is no folder; split={self.split!r} needs it")
        names = {folder[len(home) :].split("/")[0] for folder in self.listing if folder.startswith(home)} - {"", "."}
        if not names:
            raise FileNotFoundError(
                f"no class folders in {self.root / home}: put each class's recordings in a folder of its name"
            )
        return sorted(names)

    def _found(self) -> list[Sample]:
        home = "" if self.split == "all" else self.split + "/"
        found = []
        for folder, names in self.listing.items():
            label = self.class_to_idx.get(folder[len(home) :].split("/")[0]) if folder.startswith(home) else None
            if label is not None:
                found += [Sample(name, label) for name in recordings_in({folder: names})]
        return sorted(found, key=lambda sample: (sample.label, sample.name))

    def _select(self, found: list[Sample]) -> Iterable[Sample]:
        return found

    def recording_names(self) -> list[str]:
        # those of all splits: which folders are classes depends on the split
        return [name for name in recordings_in(self.listing) if "/" in name]

    def _how_to_get(self) -> str:
        return f"it needs class folders with recordings ({', '.join(formats.suffixes())})"
