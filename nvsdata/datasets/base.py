"""The base classes of all datasets."""

from __future__ import annotations

import gc
import os
import random
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from functools import cached_property
from itertools import chain, repeat
from pathlib import Path
from typing import Any, ClassVar, Self

import numpy as np
import torch

import nvsdata.data.batching  # noqa: F401  tells torch how samples become batches
from nvsdata.common.errors import shown
from nvsdata.data.recording import Recording
from nvsdata.data.views import EventRange, Slice
from nvsdata.datasets.facts import Info, Sample
from nvsdata.datasets.indexing import PairTransform, Samples, Transform, check_choice
from nvsdata.datasets.layout import nothing_below
from nvsdata.datasets.shapes import shape_of
from nvsdata.datasets.source import Folder, Source, joined, recordings_in
from nvsdata.datasets.splits import stratified


class EventDataset(Samples):
    """Recordings with class labels.

    Recordings are found wherever they lie below the root, in any known format: the nearest folder named after a
    class (in any case, with or without underscores) gives the class.

    `ds[i]` is `(sample, target)`. Without `transform` the sample is the recording's `Events`. The transform gets the
    undecoded `Recording`, so if a window transform comes first, only its window is decoded; every transform of
    nvsdata that takes events takes either.

    - `root`: a folder, or a packed store that `nvsdata pack` made from one
    - `split`: one of `splits`: "train", "test" or "all"; True and False stand for the first two, None (default) for
      the first of `splits`, unless `train` is given
    - `fold`: which of several splits; its meaning and default depend on the dataset (None takes the default)
    - `transform`: applied to the recording
    - `target_transform`: applied to the target, an int
    - `download`: whether to download what is missing below `root` first (default False)
    - `train`: True or False for the split "train" or "test", as torchvision has it (default: as `split` says).
      ValueError if `split` says otherwise
    - `transforms`: applied to recording and target, gives both, in place of `transform` and `target_transform`
    - `seed`: makes random transforms depend on (seed, epoch, index) alone; see `Samples` (default None)
    - `errors`: what happens to damaged recordings: "raise" (default), "skip" or "repair"; see `Samples`

    `classes` (names), `class_to_idx`, `targets` (list of ints, one per sample), `sensor_size` and `samples` describe
    what was found, `split_name` is what was asked for, and `split_hash` identifies it. `ds[:10]` and `ds.subset(...)`
    are datasets, too, and `ds.split(0.9)` gives two. Subclasses define `info` and how to split.

    FileNotFoundError if `root` doesn't exist or has no recordings of the split. ValueError for a split or fold that
    the dataset doesn't have, and a store of another dataset or split. TypeError for a transform that isn't callable.
    DownloadError if `download` fails.
    """

    info: ClassVar[Info]
    splits: ClassVar[tuple[str, ...]] = ("train", "test", "all")
    aliases: ClassVar[dict[str, str]] = {}  # other names of class folders
    smallest: ClassVar[int] = 0  # bytes; smaller files have no events and are left out
    independent: ClassVar[tuple[str, ...]] = ("listing", "_labels")

    def __init__(
        self,
        root: str | os.PathLike[str],
        split: str | bool | None = None,
        transform: Transform | None = None,
        target_transform: Transform | None = None,
        download: bool = False,
        *,
        fold: int | None = None,
        train: bool | None = None,
        transforms: PairTransform | None = None,
        seed: int | None = None,
        errors: str = "raise",
    ) -> None:
        self.root, self.split_name = Path(root).expanduser(), self._split_of(split, train)
        self.fold = self._check_fold(fold)
        self._set(transform, target_transform, transforms, seed, errors)
        if download:
            self._download()
        self.source = self._source()
        self.classes = self._classes()
        self.class_to_idx = {name: index for index, name in enumerate(self.classes)}
        self.skipped: list[str] = []
        with _no_collection():
            self.samples = list(self._usable(self._select(self._not_empty(self.found()))))
        if not self.samples:
            raise FileNotFoundError(self._nothing(f"no recordings for split {self.split_name!r}"))
        self._count()

    @classmethod
    def whole(cls, root: str | os.PathLike[str]) -> Self:
        """The complete dataset: every split, and what its options leave out by default."""
        return cls(root, "all")

    def _source(self) -> Source:
        if self.root.is_dir():
            return Folder(self.root)
        if self.root.is_file():
            from nvsdata.datasets.store.reader import Store

            store = Store(self.root)
            if store.dataset != self.info.name:
                raise ValueError(f"{self.root} holds {store.dataset}, not {self.info.name}")
            # a store of one split doesn't hold the others
            if store.split != "all" and (store.split, store.fold) != (self.split_name, self.fold):
                which = f"split {store.split!r}, fold {store.fold}"
                raise ValueError(f"{self.root} was packed from {which} only: pack split='all' for all others")
            return store
        raise FileNotFoundError(f"{self.root} is not a folder; {self._how_to_get()}")

    def _nothing(self, lacking: str) -> str:
        """Error message for a root in which something isn't found."""
        names = {plain(name) for name in (*self.info.classes, *self.aliases, "train", "test")}
        hint = nothing_below(self.root, self.listing, self.info.tree, names)
        return f"{lacking} below {self.root}; {hint}; {self._how_to_get()}"

    def _classes(self) -> list[str]:
        return list(self.info.classes)

    def _split_of(self, split: str | bool | None, train: bool | None) -> str:
        """The split's name: the first of `splits` if neither is given; a bool stands for "train" or "test"."""
        if train not in (None, True, False):
            raise ValueError(f"train must be True, False or None, not {train!r}")
        named = None if train is None else "train" if train else "test"
        if split is None:
            return named or self.splits[0]
        if isinstance(split, bool):
            split = "train" if split else "test"
        check_choice("split", split, self.splits)
        if named not in (None, split):
            raise ValueError(f"split={split!r} and train={train} contradict each other: give one of them")
        return split

    def _check_fold(self, fold: int | None) -> int:
        """The fold to use; ValueError for one that doesn't exist. This base class has a single split."""
        if fold is not None:
            raise ValueError(f"{type(self).__name__} has one split only: fold must be None, not {fold}")
        return 0

    @cached_property
    def listing(self) -> dict[str, list[str]]:
        """All files below the root: folder to sorted names."""
        return self.source.listing()

    def found(self) -> list[Sample]:
        """The samples of all splits, sorted by class, then by file name, whatever folders they are in."""
        by_label: dict[int, list[list[Sample]]] = {}
        for folder, names in self.listing.items():
            label = self._label_of(folder)
            if label is None:
                continue
            files = recordings_in({folder: names})
            # _make because it is faster, and there may be 100,000
            fields = zip(files, repeat(label), repeat(None), repeat(None))
            by_label.setdefault(label, []).append(list(map(Sample._make, fields)))
        found: list[Sample] = []
        for label in sorted(by_label):
            samples = list(chain.from_iterable(by_label[label]))
            # a single folder is already sorted by file name
            found += samples if len(by_label[label]) == 1 else sorted(samples, key=lambda s: (s.file, s.name))
        return found

    def _not_empty(self, found: list[Sample]) -> list[Sample]:
        """The samples without those whose file is too small to hold events."""
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
        """Label of the recordings in a folder: the class after which the nearest folder above them is named."""
        for part in reversed(folder.split("/")):
            label = self._labels.get(plain(part))
            if label is not None:
                return label
        return None

    def _select(self, found: list[Sample]) -> Iterable[Sample]:
        """The samples of the split: here, those below a folder whose name contains the split's name."""
        if self.split_name == "all":
            return found
        inside = {folder for folder in self.listing if self.part_of(folder) == self.split_name}
        chosen = [sample for sample in found if os.path.dirname(sample.name) in inside]
        if not chosen:
            raise FileNotFoundError(self._nothing(f"no folder {self.split_name.capitalize()} with recordings"))
        return chosen

    def _usable(self, samples: Iterable[Any]) -> Iterable[Any]:
        """The samples without those that a store left out. Those still count in the split, which comes before."""
        left_out = self.source.left_out
        if not left_out:
            return samples
        self.skipped += [name for name in left_out if name not in self.skipped]
        return [sample for sample in samples if left_out.keys().isdisjoint(self._files(sample))]

    def _held_out(self, found: list[Sample], for_testing: Callable[[Sample], bool]) -> list[Sample]:
        """The samples of the split, where `for_testing` selects the test samples and all others are for training."""
        return [s for s in found if self.split_name == "all" or for_testing(s) == (self.split_name == "test")]

    def part_of(self, folder: str) -> str | None:
        """The part, "train" or "test", that the name of the folder or of one above it contains; None if neither."""
        for part in folder.lower().split("/"):
            if "train" in part or "test" in part:
                return "train" if "train" in part else "test"
        return None

    def total(self) -> tuple[int, int, str]:
        """How many samples all splits have, how many they should have, and what the samples are called."""
        return len(self.found()), self.info.recordings, "recordings"

    def listed(self) -> dict[str, list[str]]:
        """Split lists found below the root: name of the list to the recordings in it, without extension."""
        return {}

    @property
    def packed_split(self) -> str:
        """The split that `recording_names` belong to."""
        return self.split_name

    @property
    def sensor_size(self) -> tuple[int, int] | None:
        """(width, height) of every recording; None if they differ."""
        return self.info.sensor_size

    @property
    def opened_with(self) -> tuple[int, int] | None:
        """The sensor size that recordings are opened with; None to use what each file states."""
        return self.sensor_size

    def recording(self, index: int) -> Recording:
        """The recording of a sample, opened but not decoded."""
        return self.part(self.samples[index])

    def part(self, sample: Sample) -> Recording:
        """What a sample is, opened but not decoded."""
        found = self.named(sample.name)
        if sample.window is not None:
            found = Slice(found, *sample.window)
        return found if sample.events is None else EventRange(found, *sample.events)

    def named(self, name: str) -> Recording:
        """A recording by its path below the root, opened but not decoded, as users see it."""
        return self._view(self.source.open(name, self.opened_with, strict=self.errors != "repair"))

    def _view(self, recording: Recording) -> Recording:
        """The recording as users see it; subclasses change coordinates or times here."""
        return recording

    def _how_to_get(self) -> str:
        by_hand = f"unpack it by hand from {self.info.page}"
        if not self.info.by_program:
            return by_hand
        return f"pass download=True (`nvsdata download {self.info.name}`), or {by_hand}"

    def _download(self) -> None:
        from nvsdata.datasets.archives.download import download

        # a packed store needs no download
        if not self.root.is_file():
            download(self.info, self.root)

    def _side_file(self, name: str) -> str | None:
        """Text of the file with that name anywhere below the root; None if there isn't one."""
        for folder, names in self.listing.items():
            if name in names:
                return self.source.data(joined(folder, name)).decode("utf-8-sig", "replace")
        return None

    def _what(self) -> str:
        files = len(self.files_of(self.samples))
        return "recordings" if files == len(self) else f"samples of {files} recordings"

    def _repr_html_(self) -> str:
        """What a notebook shows."""
        from nvsdata.datasets.notebook import as_html

        return as_html(self)

    def __repr__(self) -> str:
        return f"{type(self).__name__}: {len(self)} {self._what()}, {len(self.classes)} classes\n" + self.extra_repr()

    def extra_repr(self) -> str:
        """What the repr says below its first line."""
        size = self.info.sensor_size
        lines = [
            f"root: {shown(self.root)}",
            f"split: {self.split_name}" + (f", fold {self.fold}" if self.fold else "") + f", hash {self.split_hash}",
            f"sensor: {size[0]}x{size[1]}" if size else "sensor: as each recording states",
            f"sample: {self._sample_told()}",
        ]
        if self.skipped:
            lines.append(f"left out: {len(self.skipped)}")
        if self._damage is not None and (found := self._damage.found()):
            lines.append(f"damaged: {len(found)}")
        if self.transform is not None:
            lines.append(f"transform: {self.transform!r}")
        if self.transforms is not None:
            lines.append(f"transforms: {self.transforms!r}")
        return "\n".join(f"    {line}" for line in lines)

    def _sample_told(self) -> str:
        """Kind and shape of the first sample, which is made for it; no random numbers are used up."""
        states = torch.get_rng_state(), np.random.get_state(), random.getstate()  # noqa: NPY002
        try:
            return shape_of(self._made(0)[0])
        except Exception as error:  # a transform of the user's may raise anything
            return f"can't be made ({type(error).__name__}: {shown(error)})"
        finally:
            torch.set_rng_state(states[0])
            np.random.set_state(states[1])  # noqa: NPY002
            random.setstate(states[2])


class RandomSplitDataset(EventDataset):
    """A dataset without a split of its own: a fifth of each class is for testing, drawn by the seed `fold`.

    The split of a seed is the same on every machine: whether a recording is for testing depends on the names in
    its class, not on folders, other classes or the files' format. Adding or removing a recording moves at most one
    other recording to the other side.
    """

    def _check_fold(self, fold: int | None) -> int:
        if fold is not None and fold < 0:
            raise ValueError(f"fold is the seed of the random split: at least 0, not {fold}")
        return fold or 0

    def _select(self, found: list[Sample]) -> Iterable[Sample]:
        if self.split_name in ("all", self.source.split) or not found:
            return found
        names = [(self.classes[sample.label], self._name_of(sample)) for sample in found]
        train, test = stratified(names, 0.2, seed=self.fold)
        return [found[i] for i in (train if self.split_name == "train" else test)]


@contextmanager
def _no_collection() -> Iterator[None]:
    """Pause garbage collection: while 100,000 samples are created it would scan all objects again and again."""
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
    """A name without case, spaces and punctuation, by which class folders are recognized."""
    return "".join(c for c in name.lower() if c.isalnum())
