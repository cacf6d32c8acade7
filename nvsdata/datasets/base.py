"""What all datasets share."""

from __future__ import annotations

import gc
import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from functools import cached_property
from itertools import chain, repeat
from pathlib import Path
from typing import Any, ClassVar, Self

import nvsdata.data.batching  # noqa: F401  tells torch how samples become batches
from nvsdata.data.recording import Recording
from nvsdata.data.views import Slice
from nvsdata.datasets.facts import Info, Sample
from nvsdata.datasets.indexing import Samples, Transform, check_choice
from nvsdata.datasets.layout import nothing_below
from nvsdata.datasets.source import Folder, Source, joined, recordings_in
from nvsdata.datasets.splits import stratified


class EventDataset(Samples):
    """Recordings with class labels.

    `root` is a folder, or a file that `nvsdata pack` made of one. Recordings are found wherever they
    lie below it, in any known format: the nearest folder that bears a class's name (in any case,
    with or without underscores) gives the class.

    `ds[i]` is `(sample, target)`. Without `transform` the sample is the recording's `Events`. With
    one, it is handed the undecoded `Recording`, so that a window transform in front decodes just
    its window; every transform of nvsdata takes either.

    `seed` and `errors` (None and "raise" by default) say what transforms draw, and what becomes of damaged recordings;
    see `Samples`.

    `classes` (names), `class_to_idx`, `targets` (list of ints, one a recording), `sensor_size`
    and `samples` describe what was found, `split_hash` tells one split from another. `ds[:10]` and `ds.subset(...)`
    are datasets, too. Subclasses give `info` and say how to split.
    """

    info: ClassVar[Info]
    splits: ClassVar[tuple[str, ...]] = ("train", "test", "all")
    aliases: ClassVar[dict[str, str]] = {}  # other names of class folders
    smallest: ClassVar[int] = 0  # bytes; smaller recordings are empty, and left out
    independent: ClassVar[tuple[str, ...]] = ("listing", "_labels")

    def __init__(
        self,
        root: str | os.PathLike[str],
        split: str = "train",
        *,
        fold: int | None = None,
        transform: Transform | None = None,
        target_transform: Transform | None = None,
        download: bool = False,
        seed: int | None = None,
        errors: str = "raise",
    ) -> None:
        check_choice("split", split, self.splits)
        self.root, self.split = Path(root).expanduser(), split
        self.fold = self._check_fold(fold)
        self._set(transform, target_transform, seed, errors)
        if download:
            self._download()
        self.source = self._source()
        self.classes = self._classes()
        self.class_to_idx = {name: index for index, name in enumerate(self.classes)}
        self.skipped: list[str] = []
        with _no_collection():
            self.samples = list(self._usable(self._select(self._not_empty(self.found()))))
        if not self.samples:
            raise FileNotFoundError(self._nothing(f"no recordings for split {split!r}"))
        self._count()

    @classmethod
    def whole(cls, root: str | os.PathLike[str]) -> Self:
        """The dataset with all that it has: every split, and what its options leave out by default."""
        return cls(root, "all")

    def _source(self) -> Source:
        if self.root.is_dir():
            return Folder(self.root)
        if self.root.is_file():
            from nvsdata.datasets.store.reader import Store

            store = Store(self.root)
            if store.dataset != self.info.name:
                raise ValueError(f"{self.root} holds {store.dataset}, not {self.info.name}")
            # a part is no dataset that parts could be drawn from
            if store.split != "all" and (store.split, store.fold) != (self.split, self.fold):
                which = f"split {store.split!r}, fold {store.fold}"
                raise ValueError(f"{self.root} was packed of {which} only: pack split='all' for all others")
            return store
        raise FileNotFoundError(f"{self.root} is no folder; {self._how_to_get()}")

    def _nothing(self, lacking: str) -> str:
        """What is said of a root in which something isn't found."""
        names = {plain(name) for name in (*self.info.classes, *self.aliases, "train", "test")}
        hint = nothing_below(self.root, self.listing, self.info.tree, names)
        return f"{lacking} below {self.root}; {hint}; {self._how_to_get()}"

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

    def found(self) -> list[Sample]:
        """The samples of all splits, by class, then by name: whatever folders they were sorted into."""
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
        return found

    def _not_empty(self, found: list[Sample]) -> list[Sample]:
        """The samples but for those whose file is too small to hold events."""
        if not self.smallest:
            return found
        there = [sample.name for sample in found if sample.name not in self.source.left_out]
        self.skipped = [name for name in there if self.source.size(name) < self.smallest]
        dropped = set(self.skipped)
        return [sample for sample in found if sample.name not in dropped]

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
        inside = {folder for folder in self.listing if self.part_of(folder) == self.split}
        chosen = [sample for sample in found if os.path.dirname(sample.name) in inside]
        if not chosen:
            raise FileNotFoundError(self._nothing(f"no folder {self.split.capitalize()} with recordings"))
        return chosen

    def _usable(self, samples: Iterable[Any]) -> Iterable[Any]:
        """The samples but for those that a store was packed without: they take part in the split first."""
        left_out = self.source.left_out
        if not left_out:
            return samples
        self.skipped += [name for name in left_out if name not in self.skipped]
        return [sample for sample in samples if left_out.keys().isdisjoint(self._files(sample))]

    def _held_out(self, found: list[Sample], for_testing: Callable[[Sample], bool]) -> list[Sample]:
        """The samples of the split where a rule says which are for testing, and all others are for training."""
        return [s for s in found if self.split == "all" or for_testing(s) == (self.split == "test")]

    def part_of(self, folder: str) -> str | None:
        """The part, "train" or "test", that a folder's name or one above it has in it."""
        for part in folder.lower().split("/"):
            if "train" in part or "test" in part:
                return "train" if "train" in part else "test"
        return None

    def total(self) -> tuple[int, int, str]:
        """How many samples of all splits there are, how many there should be, and what they are called."""
        return len(self.found()), self.info.recordings, "recordings"

    def listed(self) -> dict[str, list[str]]:
        """Names of recordings, without extension, that lists beside them have: a list's name to what it names."""
        return {}

    @property
    def packed_split(self) -> str:
        """The split that `recording_names` are of."""
        return self.split

    @property
    def sensor_size(self) -> tuple[int, int] | None:
        """(width, height) of every recording, None if they differ."""
        return self.info.sensor_size

    @property
    def opened_with(self) -> tuple[int, int] | None:
        """The sensor size that recordings are opened with; None for what each states."""
        return self.sensor_size

    def recording(self, index: int) -> Recording:
        """The recording of a sample, opened but not decoded."""
        name, _, window = self.samples[index]
        whole = self.named(name)
        return whole if window is None else Slice(whole, *window)

    def named(self, name: str) -> Recording:
        """A recording by its path below the root, opened but not decoded, as users are to see it."""
        return self._view(self.source.open(name, self.opened_with, strict=self.errors != "repair"))

    def _view(self, recording: Recording) -> Recording:
        """The recording as users are to see it."""
        return recording

    def _how_to_get(self) -> str:
        by_hand = f"unpack it by hand from {self.info.page}"
        if not self.info.by_program:
            return by_hand
        return f"pass download=True (`nvsdata download {self.info.name}`), or {by_hand}"

    def _download(self) -> None:
        from nvsdata.datasets.archives.download import download

        # a packed store has all that there is
        if not self.root.is_file():
            download(self.info, self.root)

    def _side_file(self, name: str) -> str | None:
        """Text of the file of that name, wherever it lies below the root; None if it doesn't."""
        for folder, names in self.listing.items():
            if name in names:
                return self.source.data(joined(folder, name)).decode("utf-8-sig", "replace")
        return None

    def __repr__(self) -> str:
        lines = [
            f"{type(self).__name__}: {len(self)} recordings, {len(self.classes)} classes",
            f"root: {self.root}",
            f"split: {self.split}" + (f", fold {self.fold}" if self.fold else "") + f", hash {self.split_hash}",
        ]
        if self.skipped:
            lines.append(f"left out: {len(self.skipped)}")
        if self._damage is not None and (found := self._damage.found()):
            lines.append(f"damaged: {len(found)}")
        if self.transform is not None:
            lines.append(f"transform: {self.transform!r}")
        return "\n    ".join(lines)


class RandomSplitDataset(EventDataset):
    """A dataset without a split of its own: a fifth of each class is for testing, drawn by the seed `fold`.

    For a seed the split is the same on every machine: whether a recording is for testing depends on the names in
    its class, not on folders, other classes or the files' format; one more or less moves at most one other.
    """

    def _check_fold(self, fold: int | None) -> int:
        if fold is not None and fold < 0:
            raise ValueError(f"fold is the seed of the random split: at least 0, not {fold}")
        return fold or 0

    def _select(self, found: list[Sample]) -> Iterable[Sample]:
        if self.split in ("all", self.source.split) or not found:
            return found
        names = [(self.classes[sample.label], self._name_of(sample)) for sample in found]
        train, test = stratified(names, 0.2, seed=self.fold)
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
