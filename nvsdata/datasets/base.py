"""What all datasets share."""

from __future__ import annotations

import gc
import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from itertools import chain, repeat
from pathlib import Path
from typing import Any, ClassVar, NamedTuple

from torch.utils.data import Dataset

from nvsdata.datasets.source import Folder, Source, joined, recordings_in
from nvsdata.datasets.splits import stratified
from nvsdata.events import Recording
from nvsdata.views import Slice

Transform = Callable[[Any], Any]


class Sample(NamedTuple):
    """A recording: its path below the root, the index of its class, and its slice in time (µs) if it is one."""

    name: str
    label: int
    window: tuple[int, int] | None = None

    @property
    def file(self) -> str:
        """The file's name."""
        return self.name.rsplit("/", 1)[-1]

    @property
    def stem(self) -> str:
        """The file's name without its extension."""
        return self.file.rsplit(".", 1)[0]


@dataclass(frozen=True)
class Archive:
    """A file to download: `urls` are tried in order, `folder` is what it unpacks to.

    Without `urls` it needs a browser. `hash` is an md5 or a sha256, empty if none is known, as is
    `size` in bytes.
    """

    name: str
    hash: str
    urls: tuple[str, ...]
    folder: str
    size: int = 0


@dataclass(frozen=True)
class Info:
    """Facts about a dataset. `recordings` is how many there are."""

    name: str
    sensor_size: tuple[int, int] | None
    classes: tuple[str, ...]
    page: str
    licence: str
    archives: tuple[Archive, ...] = ()
    recordings: int = 0


class EventDataset(Dataset[tuple[Any, Any]]):
    """Recordings with class labels.

    `root` is a folder, or a file that `nvsdata pack` made of one. Recordings are found wherever they
    lie below it, in any known format: the nearest folder that bears a class's name (in any case,
    with or without underscores) gives the class.

    `ds[i]` is `(sample, target)`. Without `transform` the sample is the recording's `Events`. With
    one, it is handed the undecoded `Recording`, so that a window transform in front decodes just
    its window; every transform of nvsdata takes either.

    `classes` (names), `class_to_idx`, `targets` (list of ints, one a recording), `sensor_size`
    and `samples` describe what was found. Subclasses give `info` and say how to split.
    """

    info: ClassVar[Info]
    splits: ClassVar[tuple[str, ...]] = ("train", "test", "all")
    aliases: ClassVar[dict[str, str]] = {}  # other names of class folders
    smallest: ClassVar[int] = 0  # bytes; smaller recordings are empty, and left out

    def __init__(
        self,
        root: str | os.PathLike[str],
        split: str = "train",
        *,
        fold: int | None = None,
        transform: Transform | None = None,
        target_transform: Transform | None = None,
        download: bool = False,
    ) -> None:
        if split not in self.splits:
            raise ValueError(f"split must be {', '.join(map(repr, self.splits))}, not {split!r}")
        self.root, self.split = Path(root), split
        self.fold = self._check_fold(fold)
        self.transform, self.target_transform = transform, target_transform
        if download:
            self._download()
        self.source = self._source()
        self.classes = self._classes()
        self.class_to_idx = {name: index for index, name in enumerate(self.classes)}
        self.skipped: list[str] = []
        with _no_collection():
            self.samples = list(self._select(self._found()))
        self.targets = [sample.label for sample in self.samples]
        if not self.samples:
            raise FileNotFoundError(f"no recordings for split {split!r} below {self.root}; {self._how_to_get()}")

    def _source(self) -> Source:
        if self.root.is_dir():
            return Folder(self.root)
        if self.root.is_file():
            from nvsdata.datasets.store import Store

            store = Store(self.root)
            if store.dataset != self.info.name:
                raise ValueError(f"{self.root} holds {store.dataset}, not {self.info.name}")
            return store
        raise FileNotFoundError(f"{self.root} is no folder; {self._how_to_get()}")

    def _classes(self) -> list[str]:
        return list(self.info.classes)

    def _check_fold(self, fold: int | None) -> int:
        """The fold to take; ValueError for one that isn't. Here it is of no meaning."""
        if fold is not None:
            raise ValueError(f"{type(self).__name__} has one split only: fold must be None, not {fold}")
        return 0

    @cached_property
    def listing(self) -> dict[str, list[str]]:
        """All files below the root: folder to sorted names."""
        return self.source.listing()

    def _found(self) -> list[Sample]:
        """All recordings, by class, then by name: whatever folders they were sorted into."""
        by_label: dict[int, list[list[Sample]]] = {}
        for folder, names in self.listing.items():
            label = self._label_of(folder)
            if label is None:
                continue
            files = recordings_in({folder: names})
            # by _make, for there may be 100,000
            by_label.setdefault(label, []).append(list(map(Sample._make, zip(files, repeat(label), repeat(None)))))
        found: list[Sample] = []
        for label in sorted(by_label):
            samples = list(chain.from_iterable(by_label[label]))
            # one folder is in order already: by file name, as several are put
            found += samples if len(by_label[label]) == 1 else sorted(samples, key=lambda s: (s.file, s.name))
        if self.smallest:
            self.skipped = [sample.name for sample in found if self.source.size(sample.name) < self.smallest]
            dropped = set(self.skipped)
            found = [sample for sample in found if sample.name not in dropped]
        return found

    @cached_property
    def _labels(self) -> dict[str, int]:
        names = {plain(name): index for index, name in enumerate(self.classes)}
        return names | {plain(other): self.class_to_idx[name] for other, name in self.aliases.items()}

    def _label_of(self, folder: str) -> int | None:
        """Label of the recordings in a folder: of the nearest folder above them that a class is named after."""
        for part in reversed(folder.split("/")):
            label = self._labels.get(plain(part))
            if label is not None:
                return label
        return None

    def _select(self, found: list[Sample]) -> Iterable[Sample]:
        """The samples of the split: here, those below a folder whose name has the split's in it."""
        if self.split == "all":
            return found
        inside = {folder for folder in self.listing if self._part_of(folder) == self.split}
        chosen = [sample for sample in found if os.path.dirname(sample.name) in inside]
        if not chosen:
            raise FileNotFoundError(f"no folder {self.split.capitalize()} below {self.root}; {self._how_to_get()}")
        return chosen

    def _held_out(self, found: list[Sample], for_testing: Callable[[Sample], bool]) -> list[Sample]:
        """The samples of the split where a rule says which are for testing, and all others are for training."""
        return [s for s in found if self.split == "all" or for_testing(s) == (self.split == "test")]

    def _part_of(self, folder: str) -> str | None:
        for part in folder.lower().split("/"):
            if "train" in part or "test" in part:
                return "train" if "train" in part else "test"
        return None

    @property
    def sensor_size(self) -> tuple[int, int] | None:
        """(width, height) of every recording, None if they differ."""
        return self.info.sensor_size

    @property
    def opened_with(self) -> tuple[int, int] | None:
        """The sensor size that recordings are opened with; None for what each states."""
        return self.sensor_size

    def recording_names(self) -> list[str]:
        """The recordings that the samples are of, each once, by their path below the root."""
        return list(dict.fromkeys(sample.name for sample in self.samples))

    def recording(self, index: int) -> Recording:
        """The recording of a sample, opened but not decoded."""
        name, _, window = self.samples[index]
        whole = self._view(self.source.open(name, self.opened_with))
        return whole if window is None else Slice(whole, *window)

    def _view(self, recording: Recording) -> Recording:
        """The recording as users are to see it."""
        return recording

    def _how_to_get(self) -> str:
        return f"pass download=True (`nvsdata download {self.info.name}`), or unpack it by hand from {self.info.page}"

    def _download(self) -> None:
        from nvsdata.datasets.download import fetch_and_unpack

        for archive in self.info.archives:
            fetch_and_unpack(archive, self.root, self.info.page)

    def _side_file(self, name: str) -> str | None:
        """Text of the file of that name, wherever it lies below the root; None if it doesn't."""
        for folder, names in self.listing.items():
            if name in names:
                return self.source.data(joined(folder, name)).decode("utf-8-sig", "replace")
        return None

    def __len__(self) -> int:
        return len(self.samples)

    def __getitem__(self, index: int) -> tuple[Any, Any]:
        recording = self.recording(index)
        label = self.samples[index].label
        sample = recording.read() if self.transform is None else self.transform(recording)
        return sample, label if self.target_transform is None else self.target_transform(label)

    def __repr__(self) -> str:
        lines = [
            f"{type(self).__name__}: {len(self)} recordings, {len(self.classes)} classes",
            f"root: {self.root}",
            f"split: {self.split}" + (f", fold {self.fold}" if self.fold else ""),
        ]
        if self.skipped:
            lines.append(f"left out as empty: {len(self.skipped)}")
        if self.transform is not None:
            lines.append(f"transform: {self.transform!r}")
        return "\n    ".join(lines)


class RandomSplitDataset(EventDataset):
    """A dataset without a split of its own: a fifth of each class is for testing, drawn by the seed `fold`.

    For a seed the split is the same on every machine: it depends on the classes and names of the
    recordings, not on the folders they lie in.
    """

    def _check_fold(self, fold: int | None) -> int:
        if fold is not None and fold < 0:
            raise ValueError(f"fold is the seed of the random split: at least 0, not {fold}")
        return fold or 0

    def _select(self, found: list[Sample]) -> Iterable[Sample]:
        if self.split == "all" or not found:
            return found
        train, test = stratified([sample.label for sample in found], 0.2, seed=self.fold)
        return [found[i] for i in (train if self.split == "train" else test)]


@contextmanager
def _no_collection() -> Iterator[None]:
    """Python's collector rests: it would go through all that torch made, again and again, as 100,000 samples come."""
    was_on = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_on:
            gc.enable()


def numbered_fold(fold: int | None, folds: Sequence[int], default: int) -> int:
    """The fold, or the default for None; ValueError unless it is one of `folds`."""
    if fold is not None and fold not in folds:
        raise ValueError(f"fold must be {folds[0]} to {folds[-1]}, not {fold}")
    return default if fold is None else fold


def plain(name: str) -> str:
    """A name without case, spaces and punctuation: by it folders are told to be classes."""
    return "".join(c for c in name.lower() if c.isalnum())
