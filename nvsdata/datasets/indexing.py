"""Indexable samples: reading, reproducible random numbers, and replacement of damaged recordings."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Iterable, Sequence
from copy import copy
from functools import cached_property
from itertools import chain
from typing import TYPE_CHECKING, Any, ClassVar, Self, SupportsIndex, overload

import numpy as np
import torch
from torch.utils.data import Dataset

from nvsdata.data.recording import Recording, as_events
from nvsdata.datasets.damage import ERRORS, REPAIRED, UNREADABLE, Damage
from nvsdata.datasets.epochs import Epochs
from nvsdata.datasets.facts import Sample
from nvsdata.datasets.sample_list import labels_of, taken
from nvsdata.datasets.seeded import seeded
from nvsdata.datasets.sequences import window_counts
from nvsdata.datasets.splits import Halves, held_out, held_out_last, split_hash, stratified

if TYPE_CHECKING:
    from nvsdata.datasets.sample_blocks import SampleBlocks
    from nvsdata.datasets.source import Source

Transform = Callable[[Any], Any]
PairTransform = Callable[[Any, Any], tuple[Any, Any]]
"""Changes sample and target together."""


class Samples(Dataset[tuple[Any, Any]]):
    """Samples `(sample, target)` of recordings.

    With a `seed`, the random numbers of a sample's transforms depend on (seed, epoch, index) alone, for any number of
    DataLoader workers. `set_epoch` sets the epoch; without it, passes over the data are counted. The count is exact for
    workers that aren't persistent and return no sample twice in a pass. With persistent workers or without workers, a
    new pass is recognized by the first sample that is read again: the count is exact for complete passes. Call
    `set_epoch` if you stop passes early in these two cases, read single samples (`dataset[0]` counts as a pass that was
    stopped early), or use a sampler that repeats samples. To continue a training within an epoch, use `state_dict`, or
    `SeededDataset` and `SeededBatches`.

    `errors` says what to do with damaged recordings. "raise" raises FormatError, or OSError if the disk fails. "skip"
    replaces a recording that can't be read by the next readable one, with its target. Recordings are sorted by class,
    so the replacement usually has the same class. Batches keep their size and are the same for any number of workers; a
    test set counts the replacement twice. "repair" reads a partly damaged recording without the damaged part (like
    `nvsdata.open(..., strict=False)`), and replaces one that can't be read at all. With "skip" and "repair", each
    damaged recording causes one warning, and `damaged()` lists all found so far, including those found by workers. 100
    unreadable recordings in a row raise an error in any case.
    """

    samples: Sequence[Any]
    classes: list[str]
    source: Source
    transforms: PairTransform | None = None  # in place of `transform` and `target_transform`
    independent: ClassVar[tuple[str, ...]] = ()  # cached properties that don't depend on the samples
    in_scenes: ClassVar[bool] = False  # neighboring files, in order of name, often show the same scene

    def _set(
        self,
        transform: Transform | None,
        target_transform: Transform | None,
        transforms: PairTransform | None,
        seed: int | None,
        errors: str,
    ) -> None:
        """Set the transforms, the seed and the treatment of damage; ValueError or TypeError for invalid settings."""
        check_choice("errors", errors, ERRORS)
        for name, given in (("transform", transform), ("target_transform", target_transform)):
            if given is not None and not callable(given):
                raise TypeError(f"{name} must be callable, not {given!r}; T.Compose([...]) calls several in a row")
        if transforms is not None and not callable(transforms):
            raise TypeError(f"transforms must be callable, not {transforms!r}")
        if transforms is not None and (transform is not None or target_transform is not None):
            raise ValueError("transforms takes the place of transform and target_transform: give either it or them")
        self.transform, self.target_transform, self.transforms = transform, target_transform, transforms
        self.seed, self.errors = seed, errors

    def _count(self) -> None:
        """Set the attributes that depend on the samples: targets, record of damage, epochs."""
        self.targets = labels_of(self.samples)
        self._damage = None if self.errors == "raise" else Damage(len(self.samples))
        self._epochs = None if self.seed is None else Epochs(len(self.samples))

    def subset(self, indices: Iterable[int]) -> Self:
        """Return the dataset with the samples at `indices` only, in that order."""
        part = copy(self)
        part.samples = taken(self.samples, indices)
        for name in list(vars(part)):
            # drop cached values, which were computed from all samples
            if isinstance(getattr(type(self), name, None), cached_property) and name not in self.independent:
                del vars(part)[name]
        part._count()
        return part

    def split(self, fraction: float, *, seed: int = 0) -> tuple[Self, Self]:
        """Split randomly into two datasets with the same fraction of each class.

        Each has its own `transform`: set one to None, and the other keeps its augmentation. All windows and labeled
        parts of one class and one recording are in the same dataset; parts of different classes in one recording, as in
        DVS128 Gesture's trials, may be in different ones. The split depends on names alone; see `splits.stratified`.

        Args:
            fraction: fraction of each class that is in the first dataset, between 0 and 1.
            seed: seed of the random split.

        Returns:
            The two datasets.

        Raises:
            ValueError: unless 0 < fraction < 1.
        """
        if not 0 < fraction < 1:
            raise ValueError(f"fraction must be between 0 and 1, not {fraction}")
        return self._halves(lambda files: stratified(files, 1 - fraction, seed))

    def hold_out(self, fraction: float) -> tuple[Self, Self]:
        """Hold out about a fraction of each class for validation.

        A hash of class and file name decides about each file, so adding or removing files doesn't move other files. For
        datasets whose neighboring files often show the same scene (N-CARS), the last files of each class in order of
        name are held out instead. All windows and labeled parts of one class and one file are in the same dataset.

        Args:
            fraction: approximate fraction to hold out, between 0 and 1.

        Returns:
            The dataset of the remaining samples, and the dataset held out.

        Raises:
            ValueError: unless 0 < fraction < 1, or if one of the two datasets would have no recordings of a class.
        """
        return self._halves(lambda files: (held_out_last if self.in_scenes else held_out)(files, fraction))

    def _halves(self, split: Callable[[list[tuple[str, str]]], Halves]) -> tuple[Self, Self]:
        """Split the dataset into two; samples of one file stay together.

        `split` takes the class and the name (without folder and extension) of each file, and returns the indices of
        the files in each of the two datasets.
        """
        files: dict[tuple[str, str], list[int]] = {}
        for index, sample in enumerate(self.samples):
            names = " ".join(name.rsplit("/", 1)[-1].rsplit(".", 1)[0] for name in self._files(sample))
            files.setdefault((self.classes[sample.label], names), []).append(index)
        members = list(files.values())
        first, second = (sorted(chain.from_iterable(members[n] for n in side)) for side in split(list(files)))
        return self.subset(first), self.subset(second)

    @property
    def class_counts(self) -> list[int]:
        """Number of samples of each class."""
        return list(map(int, np.bincount(np.array(self.targets, np.int64), minlength=len(self.classes))))

    @property
    def class_weights(self) -> torch.Tensor:
        """Weight of each class, float32 [classes]: inverse to its number of samples; 0 for a class without samples.

        The mean weight of a sample is 1. Pass the weights to `CrossEntropyLoss(weight=...)`, or sample all classes
        equally often by `WeightedRandomSampler(ds.class_weights[ds.targets], len(ds))`.
        """
        counts = torch.tensor(self.class_counts, dtype=torch.float32)
        return torch.where(counts > 0, len(self) / (counts.clamp(min=1) * (counts > 0).sum()), 0.0)

    @abstractmethod
    def recording(self, index: int) -> Recording:
        """Return the recording of a sample, opened but not decoded."""

    def recording_names(self) -> list[str]:
        """Return the recordings of all samples, each once, by their path below the root."""
        return list(self.files_of(self.samples))

    def files_of(self, samples: Iterable[Any]) -> dict[str, None]:
        """Return the paths below the root of the files that contain the samples, each once, in order."""
        return dict.fromkeys(name for sample in samples for name in self._files(sample))

    def recordings(self, index: int) -> tuple[Recording, ...]:
        """Return the recordings of a sample, opened but not decoded."""
        return (self.recording(index),)

    def combine(self, parts: Sequence[Any]) -> Any:
        """Return the sample made of its transformed recordings `parts`."""
        return parts[0]

    def _files(self, sample: Any) -> tuple[str, ...]:
        """Return the paths below the root of the files that contain a sample."""
        return (sample.name,)

    @classmethod
    def _name_of(cls, sample: Any) -> str:
        """Return a name that identifies a sample within its class, independent of the folder of its file."""
        return str(sample.stem + sample.part)

    @cached_property
    def names(self) -> list[tuple[str, str]]:
        """Class and name of each sample, on which random splits depend.

        They depend neither on the folder of a file nor on its position in a split.
        """
        return [(self.classes[sample.label], self._name_of(sample)) for sample in self.samples]

    @cached_property
    def split_hash(self) -> str:
        """16 hex digits that identify the samples by class, name and label.

        They are the same whether the dataset is read from its folder or from a packed store.
        """
        return split_hash((*name, label) for name, label in zip(self.names, self.targets, strict=True))

    def blocks(self, size: int = 8 << 20, at_once: int = 64) -> SampleBlocks:
        """Return the samples in blocks of neighbors in a packed store, for `SeededBatches(..., blocks=...)`.

        Args:
            size: Bytes of a block (default 8 MiB, as remote stores are read).
            at_once: Smallest number of blocks whose samples are mixed (default 64, which are 512 MiB; a store of less
                than twice as many has a uniform order). Fewer make the first batch come sooner from a slow server, but
                batches less random. With more processes, use their number: then each of them reads other blocks.

        Raises:
            ValueError: The root isn't a packed store of the third layout, or a number is less than 1.
        """
        from nvsdata.datasets.sample_blocks import blocks_of

        return blocks_of(self.source, [self._record_of(sample) for sample in self.samples], size, at_once)

    def windows_per_recording(self) -> np.ndarray:
        """Return the number of windows of each recording, int64 [recordings], for `SequenceBatches`.

        A labeled part of a recording counts as a recording. The numbers follow from `samples`: neighbors are of one
        recording if they have the same file and class, are in order of time, and overlap, touch or have the most
        common distance. So a window that was left out of the dataset divides its recording in two.

        Raises:
            TypeError: The samples aren't windows.
        """
        if not all(isinstance(sample, Sample) and sample.window is not None for sample in self.samples):
            raise TypeError("the samples aren't windows: nvsdata.windows makes a dataset of windows")
        return window_counts(self.samples)

    def _record_of(self, sample: Any) -> str:
        """Return the name of a sample's record in a store."""
        return self._files(sample)[0]

    def __len__(self) -> int:
        return len(self.samples)

    @overload
    def __getitem__(self, index: SupportsIndex) -> tuple[Any, Any]: ...

    @overload
    def __getitem__(self, index: slice) -> Self: ...

    def __getitem__(self, index: Any) -> Any:
        """Return the sample and target at an index; for a slice, a dataset. IndexError beyond the ends."""
        if isinstance(index, slice):
            return self.subset(range(len(self))[index])
        if self._damage is None and self._epochs is None:
            return self._made(index)
        return self.seeded_sample(range(len(self))[index], self._made)

    def set_epoch(self, epoch: int) -> None:
        """Make random numbers depend on (seed, `epoch`, index) until the next call, also in running workers.

        Call it before each pass over the data, as for torch's `DistributedSampler`. Without a `seed` it does nothing.

        Args:
            epoch: number of the epoch, at least 0.
        """
        if epoch < 0:
            raise ValueError(f"epoch must be at least 0, not {epoch}")
        if self._epochs is not None:
            self._epochs.set(epoch)

    def state_dict(self) -> dict[str, Any]:
        """Return the state of the random numbers: seed, epoch and what of the epoch was read.

        torchdata's `StatefulDataLoader` calls it. The dict is empty without a `seed`.
        """
        return {} if self._epochs is None else {"seed": self.seed} | self._epochs.state_dict()

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Continue with the random numbers of a state.

        The epoch goes on where the state was taken. If that was in the main process, while workers read, the next epoch
        begins: `StatefulDataLoader` takes the states of its workers. With persistent workers, call `set_epoch` before
        each pass instead.

        Args:
            state: what `state_dict` returned.

        Raises:
            ValueError: the state has another seed, or is of a dataset with another number of samples.
        """
        if state.get("seed") != self.seed:
            raise ValueError(f"the state has seed={state.get('seed')}, and the dataset seed={self.seed}")
        if self._epochs is not None:
            self._epochs.load_state_dict(state)

    def seeded_sample(self, index: int, make: Callable[[int], Any]) -> Any:
        """Return `make(index)` with the random numbers of `seed`; for a damaged recording, the replacement."""
        if self._epochs is not None and self.seed is not None:
            with seeded(self.seed, self._epochs.of(index), index):
                return self._readable(index, make)
        return self._readable(index, make)

    def _readable(self, index: int, make: Callable[[int], Any]) -> Any:
        return make(index) if self._damage is None else self._damage.first_readable(index, make)

    def _made(self, index: int) -> tuple[Any, Any]:
        recordings = self.recordings(index)
        if self.transforms is not None:
            whole = recordings[0] if len(recordings) == 1 else recordings
            sample, target = self.transforms(whole, self.target(index))
        else:
            change = self.transform or as_events
            sample, target = self.combine([change(recording) for recording in recordings]), self.target(index)
        self.note_repairs(index, recordings)
        return sample, target

    def target(self, index: int) -> Any:
        """Return the target of a sample."""
        label = self.targets[index]
        return label if self.target_transform is None else self.target_transform(label)

    def note_repairs(self, index: int, recordings: Sequence[Recording]) -> bool:
        """Record the sample as damaged if its recordings were repaired during reading; return whether they were."""
        repaired = any(recording.repairs for recording in recordings)
        if self._damage is not None and repaired:
            self._damage.mark(index, REPAIRED, f"{self._files(self.samples[index])[0]}: {_repairs(recordings)}")
        return repaired

    @property
    def num_damaged(self) -> int:
        """Number of damaged samples that all workers have found so far."""
        return 0 if self._damage is None else len(self._damage.found())

    def damaged(self) -> dict[str, str]:
        """Return the damaged samples that all workers have found so far.

        The recordings are read again to find the reasons.

        Returns:
            Paths of each sample's recordings, mapped to "replaced" or "repaired" with the reason. Empty for
            `errors="raise"`.
        """
        found = {} if self._damage is None else self._damage.found()
        return {" ".join(self._files(self.samples[i])): self._reason(i, what == REPAIRED) for i, what in found.items()}

    def _reason(self, index: int, repaired: bool) -> str:
        try:
            recordings = self.recordings(index)
            for recording in recordings:
                recording.read()
            self.target(index)
        except UNREADABLE as error:
            return f"replaced: {error}"
        return f"repaired: {_repairs(recordings)}" if repaired else "replaced, but it can be read now"


def check_choice(name: str, given: Any, choices: Sequence[str]) -> None:
    """Raise ValueError unless `given` is one of the choices; TypeError if it is a transform, passed by mistake."""
    if callable(given):
        raise TypeError(f"{name} must be {', '.join(map(repr, choices))}; pass transform={given!r} by keyword")
    if given not in choices:
        raise ValueError(f"{name} must be {', '.join(map(repr, choices))}, not {given!r}")


def _repairs(recordings: Sequence[Recording]) -> str:
    return ", ".join(f"{count} {what}" for recording in recordings for what, count in recording.repairs.items())
