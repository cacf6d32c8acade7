"""Cache on disk: the output of the deterministic first transforms of a pipeline."""

from __future__ import annotations

import hashlib
import os
import time
import warnings
from collections.abc import Callable, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any

from torch.utils.data import Dataset, Subset

from nvsdata._version import __version__
from nvsdata.common.errors import shown
from nvsdata.common.files import atomic, put, remove_link, sealed, sweep, unsealed
from nvsdata.data.recording import as_events
from nvsdata.datasets.base import EventDataset
from nvsdata.datasets.cache_files import packed, unpacked
from nvsdata.datasets.cache_identity import described
from nvsdata.datasets.source import CACHE_TAG
from nvsdata.transforms.compose import Compose

TAG = b"Signature: 8a477f597d28d172789f06886806bc55\n# made by nvsdata.cache; what is here can be made again\n"
SHARD = 1000  # samples per folder
MOST = 1 << 30  # bytes of a sample; longer ones are made each time
# attributes of a dataset that don't change the head's output
INDIFFERENT = (
    "transform",
    "target_transform",
    "transforms",
    "boxes",
    "seed",
    "errors",
    "split_name",
    "fold",
    "_damage",
    "_epochs",
)
# attributes that follow from the samples and their files' stamps
FOUND = ("source", "class_to_idx", "samples", "targets", "skipped")


class Cached(Dataset[tuple[Any, Any]]):
    """A dataset that reads from disk the samples it has made before; see `cache`."""

    def __init__(self, dataset: EventDataset, path: Path) -> None:
        if dataset.transforms is not None:
            raise ValueError("a cache keeps what `transform` makes, and this dataset has `transforms`")
        steps = _steps(dataset.transform)
        cut = next((i for i, step in enumerate(steps) if not getattr(step, "deterministic", False)), len(steps))
        if steps and not cut:
            raise ValueError(f"nothing to keep: the pipeline begins with {steps[0]!r}, which isn't deterministic")
        self.dataset, self.head, self.tail = dataset, Compose(steps[:cut]), Compose(steps[cut:])
        key = "\n".join((__version__, *_identity(dataset), *map(described, steps[:cut])))
        self.folder = path / hashlib.sha256(key.encode("utf-8", "surrogatepass")).hexdigest()[:16]
        self._full = False
        if self.folder.is_dir():
            sweep(self.folder)

    def __len__(self) -> int:
        return len(self.dataset)

    def __getitem__(self, index: Any) -> Any:
        if isinstance(index, slice):
            return Subset(self, range(len(self))[index])
        return self.dataset.taken(range(len(self))[index], self._made)

    def set_epoch(self, epoch: int) -> None:
        """Set the epoch of random numbers; see `Samples.set_epoch`."""
        self.dataset.set_epoch(epoch)

    def _made(self, index: int) -> tuple[Any, Any]:
        file = self.folder / str(index // SHARD) / f"{index}.pt"
        stamps = self._stamps(index)
        parts = _load(file, stamps)
        if parts is None:
            at = time.time_ns()
            recordings = self.dataset.recordings(index)
            change = self.head if self.head.transforms else as_events
            parts = [change(recording) for recording in recordings]
            repaired = self.dataset.note_repairs(index, recordings)
            # a file changed just now may change again with the same stamp; repaired ones must be counted each time
            if not (self._full or repaired) and all(
                self.dataset.source.settled(name, at) for name in self._files(index)
            ):
                self._keep(parts, stamps, file)
        return self.dataset.joined([self.tail(part) for part in parts]), self.dataset.target(index)

    def _files(self, index: int) -> Sequence[str]:
        return list(self.dataset.files_of([self.dataset.samples[index]]))

    def _stamps(self, index: int) -> list[list[int]]:
        return [list(self.dataset.source.stamp(name)) for name in self._files(index)]

    def _keep(self, parts: list[Any], stamps: list[list[int]], file: Path) -> None:
        try:
            tag = self.folder.parent / CACHE_TAG
            if not os.path.lexists(tag):
                tag.parent.mkdir(parents=True, exist_ok=True)
                put(tag, TAG)
            _save(parts, stamps, file)
        except OSError as error:
            # training goes on; this process no longer tries
            self._full = True
            told = f"{self.folder} can't be written to, samples are made again each time: {error}"
            warnings.warn(shown(told), stacklevel=2)

    def __getattr__(self, name: str) -> Any:
        if name == "dataset":  # while it is unpickled
            raise AttributeError(name)
        return getattr(self.dataset, name)

    def __repr__(self) -> str:
        return f"{self.dataset!r}\n    cached: {self.head!r} in {shown(self.folder)}"


def cache(dataset: EventDataset, path: str | os.PathLike[str]) -> Cached:
    """The dataset, with the output of its first, deterministic transforms (the head) stored below `path`.

    The head consists of the leading transforms with `deterministic = True` (`Window`, `RadiusGraph`, and
    your own that declare it); the transforms after it, such as augmentation, are called each time. The cache depends
    on the samples' names, the dataset's options and the settings of the head's transforms: if one of them changes,
    all samples are made again. A sample is also made again if the size or modification time of its file has changed.
    A change in the code of your own transforms isn't detected: empty the folder then.

    - `dataset`: with the pipeline as its `transform`
    - `path`: folder of the cache, made if needed; several caches may share it

    Several workers and processes may share a cache: each file appears complete or not at all. Unfinished files of
    killed processes are removed when a cache is opened. If the disk is full or not writable, each process warns once,
    and samples are made again each time.

    ValueError if the pipeline begins with a transform that isn't deterministic. TypeError if a transform of the head
    doesn't show its settings (it is neither a dataclass nor has its own `__repr__`), and, at indexing, if a
    sample can't be stored: only Events, graphs, tensors, arrays, numbers, strings, and tuples, lists and dicts of
    them can.
    """
    return Cached(dataset, Path(path).expanduser())


def _steps(transform: Callable[[Any], Any] | None) -> list[Callable[[Any], Any]]:
    """The transforms in order, with every nested Compose flattened."""
    if transform is None:
        return []
    # a subclass may call them differently
    if type(transform) is not Compose:
        return [transform]
    return [step for part in transform.transforms for step in _steps(part)]


def _identity(dataset: EventDataset) -> Sequence[str]:
    """What distinguishes datasets: class, options and samples."""
    options = {
        name: described(value)
        for name, value in vars(dataset).items()
        if name not in (*INDIFFERENT, *FOUND)
        # and not values computed since
        and not isinstance(getattr(type(dataset), name, None), cached_property)
    }
    digest = hashlib.sha256()
    for sample in dataset.samples:
        digest.update(repr(sample).encode("utf-8", "surrogatepass"))
    return type(dataset).__module__, type(dataset).__qualname__, repr(sorted(options.items())), digest.hexdigest()


def _save(parts: list[Any], stamps: list[list[int]], file: Path) -> None:
    content = packed([stamps, parts])
    if len(content) > MOST:
        return
    for folder in (file.parent.parent, file.parent):
        remove_link(folder)
    file.parent.mkdir(parents=True, exist_ok=True)
    with atomic(file) as temporary, temporary.open("wb") as out:
        out.write(sealed(content))
        out.write(content)


def _load(file: Path, stamps: list[list[int]]) -> list[Any] | None:
    """The stored parts if they belong to these stamps; None if they don't, are missing or aren't what is kept."""
    content = unsealed(file, MOST)
    if content is None:
        return None
    try:
        found, parts = unpacked(content)
    except (ValueError, TypeError):
        return None  # made again
    # a part for each file, or two of one file
    return parts if found == stamps and isinstance(parts, list) and len(parts) >= len(stamps) else None
