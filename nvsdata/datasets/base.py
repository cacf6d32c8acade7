"""What all datasets share."""

from __future__ import annotations

import os
from abc import abstractmethod
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, NamedTuple

from torch.utils.data import Dataset

from nvsdata import formats
from nvsdata.events import Recording

Transform = Callable[[Any], Any]


class Sample(NamedTuple):
    """A recording and the index of its class."""

    path: Path
    label: int


@dataclass(frozen=True)
class Archive:
    """A file to download: `urls` are tried in order, `folder` is what it unpacks to."""

    name: str
    md5: str
    urls: tuple[str, ...]
    folder: str


@dataclass(frozen=True)
class Info:
    """Facts about a dataset."""

    name: str
    sensor_size: tuple[int, int] | None
    classes: tuple[str, ...]
    page: str
    licence: str
    archives: tuple[Archive, ...] = ()


class EventDataset(Dataset[tuple[Any, Any]]):
    """Recordings with class labels.

    `ds[i]` is `(sample, target)`. Without `transform` the sample is the recording's `Events`. With
    one, it is handed the undecoded `Recording`, so that a window transform in front decodes just
    its window; every transform of nvsdata takes either.

    `classes` (names), `class_to_idx`, `targets` (list of ints, one a recording), `sensor_size`
    and `samples` describe what was found. Subclasses give `info`, `splits` and `_samples`.
    """

    info: ClassVar[Info]
    splits: ClassVar[tuple[str, ...]] = ("train", "test", "all")

    def __init__(
        self,
        root: str | os.PathLike[str],
        split: str = "train",
        *,
        transform: Transform | None = None,
        target_transform: Transform | None = None,
        download: bool = False,
    ) -> None:
        if split not in self.splits:
            raise ValueError(f"split must be {', '.join(map(repr, self.splits))}, not {split!r}")
        self.root, self.split = Path(root), split
        self.transform, self.target_transform = transform, target_transform
        if download:
            self._download()
        if not self.root.is_dir():
            raise FileNotFoundError(f"{self.root} is no folder; {self._how_to_get()}")
        self.classes = self._classes()
        self.class_to_idx = {name: index for index, name in enumerate(self.classes)}
        self.samples = list(self._samples())
        self.targets = [sample.label for sample in self.samples]
        if not self.samples:
            raise FileNotFoundError(f"no recordings for split {split!r} below {self.root}; {self._how_to_get()}")

    def _classes(self) -> list[str]:
        return list(self.info.classes)

    @abstractmethod
    def _samples(self) -> Iterable[Sample]:
        """The recordings of the split, in an order that is the same on every machine."""

    @property
    def sensor_size(self) -> tuple[int, int] | None:
        """(width, height) of every recording, None if they differ."""
        return self.info.sensor_size

    def _open(self, path: Path) -> Recording:
        return formats.open(path, sensor_size=self.sensor_size)

    def _how_to_get(self) -> str:
        return f"pass download=True, or unpack it by hand from {self.info.page}"

    def _download(self) -> None:
        from nvsdata.datasets.download import fetch_and_unpack

        for archive in self.info.archives:
            fetch_and_unpack(archive, self.root)

    def __len__(self) -> int:
        return len(self.samples)

    def __getitem__(self, index: int) -> tuple[Any, Any]:
        path, label = self.samples[index]
        recording = self._open(path)
        sample = recording.read() if self.transform is None else self.transform(recording)
        return sample, label if self.target_transform is None else self.target_transform(label)

    def __repr__(self) -> str:
        lines = [
            f"{type(self).__name__}: {len(self)} recordings, {len(self.classes)} classes",
            f"root: {self.root}",
            f"split: {self.split}",
        ]
        if self.transform is not None:
            lines.append(f"transform: {self.transform!r}")
        return "\n    ".join(lines)


def recordings_in(folder: Path) -> list[Path]:
    """Files below `folder` whose extension a known format has, sorted by name; hidden ones don't count."""
    known = formats.suffixes()
    found: list[Path] = []
    for parent, folders, names in os.walk(folder):
        folders[:] = sorted(name for name in folders if not name.startswith("."))
        found += [
            Path(parent, name) for name in sorted(names) if not name.startswith(".") and name.lower().endswith(known)
        ]
    return found
