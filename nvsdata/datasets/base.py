"""The base class of all datasets."""

from __future__ import annotations

import gc
import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar, Self

import nvsdata.data.batching  # noqa: F401  registers how samples become batches
from nvsdata.common.errors import shown
from nvsdata.common.text import plain_name
from nvsdata.data.recording import Recording
from nvsdata.data.views import EventRange, Slice
from nvsdata.datasets.description import notebook_view, nothing_below, shape_made_by
from nvsdata.datasets.facts import Info, Sample
from nvsdata.datasets.indexing import PairTransform, Samples, Transform, check_choice
from nvsdata.datasets.sample_list import ListedRecordings, SampleList, taken
from nvsdata.datasets.source import Folder, Recordings, Source, path_below
from nvsdata.remote.url import Url, place_of


class EventDataset(Samples):
    """Recordings with class labels.

    Recordings are found recursively below `root`, in any known format. The class is that of the nearest folder that is
    named after a class (in any case, with or without underscores).

    `dataset[i]` is `(sample, target)`. Without a `transform` the sample is the recording's `Events`. A transform gets
    the undecoded `Recording`, so that a pipeline that begins with a window decodes only the window; every transform of
    nvsdata that takes `Events` also takes a `Recording`. `dataset[:10]` and `dataset.subset(...)` are datasets, and
    `dataset.split(0.9)` returns two. Subclasses define `info` and how to split.

    Args:
        root: a folder, or a packed store that `nvsdata pack` made from one: a path, or a URL such as s3://bucket/a.nvs.
        split: one of `splits`: "train", "test" or "all" (default: the first of them).
        transform: applied to the recording.
        target_transform: applied to the target, an int.
        download: whether to download what is missing below `root` first.
        fold: number of the split, for datasets that have several; its meaning and default depend on the dataset.
        train: True for split="train", False for split="test", as in torchvision.
        transforms: a function of recording and target that returns both, in place of `transform` and
            `target_transform`.
        seed: makes random transforms depend on (seed, epoch, index) alone; see `Samples`. None uses torch's generator.
        errors: what to do with damaged recordings: "raise", "skip" (the next recording takes its place) or "repair"
            (reads it without the damaged part); see `Samples`.

    Attributes:
        classes: names of the classes, in the order of their labels.
        class_to_idx: name of a class to its label.
        samples: a sequence with one `Sample` for each sample.
        targets: label of each sample, ints.
        sensor_size: (width, height) in pixels of every recording; None if they differ.
        split_name: the split.
        split_hash: 16 hex digits that identify the split.
        skipped: names of recordings that are left out, because they are empty or couldn't be packed.

    Raises:
        FileNotFoundError: `root` doesn't exist or has no recordings of the split.
        ValueError: the dataset doesn't have the split or fold, `split` and `train` contradict each other, or `root` is
            a store of another dataset or split.
        TypeError: a transform can't be called.
        DownloadError: `download` fails.

    Example:
        >>> import tempfile, nvsdata
        >>> from pathlib import Path
        >>> root = Path(tempfile.mkdtemp())
        >>> (root / "waving").mkdir()
        >>> _ = nvsdata.write(nvsdata.example(), root / "waving/0.npy")
        >>> dataset = nvsdata.EventFolder(root)
        >>> len(dataset), dataset.classes, dataset[0][1]
        (1, ['waving'], 0)
    """

    info: ClassVar[Info]
    splits: ClassVar[tuple[str, ...]] = ("train", "test", "all")
    aliases: ClassVar[dict[str, str]] = {}  # other names of class folders
    smallest: ClassVar[int] = 0  # bytes; smaller files have no events and are left out
    independent: ClassVar[tuple[str, ...]] = ("listing", "_recordings", "_labels")

    def __init__(
        self,
        root: str | os.PathLike[str],
        split: str | None = None,
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
        self.root: Path | Url = place_of(root)
        self.split_name = self._split_of(split, train)
        self.fold = self._check_fold(fold)
        self._set(transform, target_transform, transforms, seed, errors)
        if download:
            self._download()
        self.source = self._source()
        self.classes = self._classes()
        self.class_to_idx = {name: index for index, name in enumerate(self.classes)}
        self.skipped: list[str] = []
        with _no_collection():
            found = self._usable(self._select(self._not_empty(self.found())))
            self.samples = found if isinstance(found, SampleList) else list(found)
        if not self.samples:
            raise FileNotFoundError(self._nothing(f"no recordings for split {self.split_name!r}"))
        self._count()

    @classmethod
    def complete(cls, root: str | os.PathLike[str]) -> Self:
        """Return the dataset with the samples of all splits, and with those that its options exclude by default."""
        return cls(root, "all")

    def _source(self) -> Source:
        if isinstance(self.root, Path) and self.root.is_dir():
            return Folder(self.root)
        if not _is_file(self.root):
            raise FileNotFoundError(f"{self.root} is not a folder; {self._how_to_get()}")
        from nvsdata.datasets.store.opening import open_store, refuse_shard

        store = open_store(self.root)
        if store.precomputed is not None:
            raise ValueError(f"{self.root} has precomputed samples: open it with nvsdata.Precomputed")
        if store.dataset != self.info.name:
            raise ValueError(f"{self.root} contains {store.dataset}, not {self.info.name}")
        refuse_shard(store, self.root)
        # a store of one split doesn't contain the others
        if store.split != "all" and (store.split, store.fold) != (self.split_name, self.fold):
            which = f"split {store.split!r}, fold {store.fold}"
            raise ValueError(f"{self.root} was packed from {which} only: pack split='all' to use other splits")
        return store

    def _nothing(self, missing: str) -> str:
        """Return the error message for `missing` data: what is expected and found below the root, where to get it."""
        names = {plain_name(name) for name in (*self.info.classes, *self.aliases, "train", "test")}
        hint = nothing_below(self.root, self.listing, self.info.tree, names)
        return f"{missing} below {self.root}; {hint}; {self._how_to_get()}"

    def _classes(self) -> list[str]:
        return list(self.info.classes)

    def _split_of(self, split: str | None, train: bool | None) -> str:
        """Return the split's name; if neither argument is given, the first of `splits`."""
        if train not in (None, True, False):
            raise ValueError(f"train must be True, False or None, not {train!r}")
        named = None if train is None else "train" if train else "test"
        if split is None:
            return named or self.splits[0]
        check_choice("split", split, self.splits)
        if named not in (None, split):
            raise ValueError(f"split={split!r} and train={train} contradict each other: give one of them")
        return split

    def _check_fold(self, fold: int | None) -> int:
        """Return the fold to use; ValueError for a fold that doesn't exist. This base class has a single split."""
        if fold is not None:
            raise ValueError(f"{type(self).__name__} has one split only: fold must be None, not {fold}")
        return 0

    @cached_property
    def listing(self) -> dict[str, list[str]]:
        """All files below the root: folder to sorted file names."""
        return self.source.listing()

    @cached_property
    def _recordings(self) -> Recordings:
        found = self.source.recordings()
        return ListedRecordings(self.listing) if found is None else found

    def found(self) -> Sequence[Sample]:
        """Return the samples of all splits, sorted by class, then by file name, regardless of their folders."""
        return SampleList.sorted(self._recordings, self._label_of, by_file=True)

    def _not_empty(self, found: Sequence[Sample]) -> Sequence[Sample]:
        """Return the samples without those whose file is too small to contain events."""
        if not self.smallest:
            return found
        there = [sample.name for sample in found if sample.name not in self.source.left_out]
        self.skipped = [name for name in there if self.source.size(name) < self.smallest]
        dropped = set(self.skipped)
        return [sample for sample in found if sample.name not in dropped]

    @cached_property
    def _labels(self) -> dict[str, int]:
        names = {plain_name(name): index for index, name in enumerate(self.classes)}
        return names | {plain_name(other): self.class_to_idx[name] for other, name in self.aliases.items()}

    def _label_of(self, folder: str) -> int | None:
        """Return the label of a folder's recordings, by the nearest folder named after a class; None if none is."""
        for part in reversed(folder.split("/")):
            label = self._labels.get(plain_name(part))
            if label is not None:
                return label
        return None

    def _select(self, found: Sequence[Any]) -> Iterable[Sample]:
        """Return the samples of the split: by default, those below a folder whose name contains the split's name."""
        if self.split_name == "all":
            return found
        chosen: Sequence[Sample]
        if isinstance(found, SampleList):
            chosen = found.within(lambda folder: self.part_of(folder) == self.split_name)
        else:
            chosen = [sample for sample in found if self.part_of(os.path.dirname(sample.name)) == self.split_name]
        if not chosen:
            raise FileNotFoundError(self._nothing(f"no folder {self.split_name.capitalize()} with recordings"))
        return chosen

    def _usable(self, samples: Iterable[Any]) -> Iterable[Any]:
        """Return the samples without those that a store left out. The split was made before, with all samples."""
        left_out = self.source.left_out
        if not left_out:
            return samples
        self.skipped += [name for name in left_out if name not in self.skipped]
        return [sample for sample in samples if left_out.keys().isdisjoint(self._files(sample))]

    def _held_out(self, found: Sequence[Sample], for_testing: Callable[[Sample], bool]) -> Sequence[Sample]:
        """Return the samples of the split: `for_testing` selects the test samples, all others are for training."""
        if self.split_name == "all":
            return found
        testing = self.split_name == "test"
        return taken(found, [i for i, sample in enumerate(found) if for_testing(sample) == testing])

    def part_of(self, folder: str) -> str | None:
        """Return "train" or "test", from the first name in the folder's path that contains one; None if none does."""
        for part in folder.lower().split("/"):
            if "train" in part or "test" in part:
                return "train" if "train" in part else "test"
        return None

    def total(self) -> tuple[int, int, str]:
        """Return the number of samples of all splits, the expected number, and the plural noun for such samples."""
        return len(self.found()), self.info.recordings, "recordings"

    def split_lists(self) -> dict[str, list[str]]:
        """Return the files below the root that list a split: file name to names of recordings, without extension."""
        return {}

    @property
    def packed_split(self) -> str:
        """The split to which the recordings of `recording_names` belong."""
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
        """Return the recording of a sample, opened but not decoded."""
        return self.part(self.samples[index])

    def part(self, sample: Sample) -> Recording:
        """Return the part of a recording that a sample consists of, opened but not decoded."""
        found = self.open_recording(sample.name)
        if sample.window is not None:
            found = Slice(found, *sample.window)
        return found if sample.events is None else EventRange(found, *sample.events)

    def open_recording(self, name: str) -> Recording:
        """Return a recording by its path below the root, opened but not decoded, with the conversions of `_view`."""
        return self._view(self.source.open(name, self.opened_with, strict=self.errors != "repair"))

    def _view(self, recording: Recording) -> Recording:
        """Return the recording unchanged; subclasses convert the dataset's coordinates or times here."""
        return recording

    def _how_to_get(self) -> str:
        manually = f"unpack it manually from {self.info.page}"
        if not self.info.by_program:
            return manually
        return f"pass download=True (`nvsdata download {self.info.name}`), or {manually}"

    def _download(self) -> None:
        from nvsdata.datasets.archives.download import download

        # a packed store needs no download
        if isinstance(self.root, Path) and not self.root.is_file():
            download(self.info, self.root)

    def _side_file(self, name: str) -> str | None:
        """Return the text of the file with that name anywhere below the root; None if there isn't one."""
        for folder, names in self.listing.items():
            if name in names:
                return self.source.data(path_below(folder, name)).decode("utf-8-sig", "replace")
        return None

    def _samples_in_words(self) -> str:
        files = len(self.files_of(self.samples))
        return "recordings" if files == len(self) else f"samples of {files} recordings"

    def _repr_html_(self) -> str:
        """Return the HTML that a notebook shows."""
        return notebook_view(self)

    def __repr__(self) -> str:
        return (
            f"{type(self).__name__}: {len(self)} {self._samples_in_words()}, {len(self.classes)} classes\n"
            + self.extra_repr()
        )

    def extra_repr(self) -> str:
        """Return the lines of the repr below the first."""
        size = self.info.sensor_size
        lines = [
            f"root: {shown(self.root)}",
            f"split: {self.split_name}" + (f", fold {self.fold}" if self.fold else "") + f", hash {self.split_hash}",
            f"sensor: {size[0]}x{size[1]}" if size else "sensor: as each recording states",
            f"sample: {shape_made_by(lambda: self._made(0)[0])}",
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


def _is_file(root: Path | Url) -> bool:
    """Return whether a root isn't a folder. A URL never is one."""
    return isinstance(root, Url) or root.is_file()


@contextmanager
def _no_collection() -> Iterator[None]:
    """Pause garbage collection, which would scan all objects repeatedly while 100,000 samples are created."""
    was_on = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_on:
            gc.enable()
