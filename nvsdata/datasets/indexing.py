"""Samples that can be indexed: what they are made of, what is drawn for them, and what becomes of damaged ones."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Iterable, Sequence
from copy import copy
from functools import cached_property
from typing import Any, ClassVar, Self

from torch.utils.data import Dataset

from nvsdata.data.recording import Recording, as_events
from nvsdata.datasets.damage import ERRORS, REPAIRED, UNREADABLE, Damage
from nvsdata.datasets.seeded import Passes, seeded
from nvsdata.datasets.splits import split_hash

Transform = Callable[[Any], Any]


class Samples(Dataset[tuple[Any, Any]]):
    """Samples `(sample, target)` of recordings.

    `seed`: what a sample's transforms draw depends on (seed, epoch, index) alone, for any number of a DataLoader's
    workers. The epoch is how often this object has given the sample before: a pass that is left early counts what its
    workers had made ahead (`SeededBatches` says the epoch itself). None (default) leaves torch's generator.

    `errors` says what becomes of damaged recordings. "raise" (default): FormatError, or OSError if the disk fails.
    "skip": the next recording that can be read takes the place of one that can't, with its target; as recordings
    are in order of their classes, that is one of the same class as a rule. So batches keep their size, and are the
    same for any number of workers; a test set counts that neighbor twice. "repair": what is damaged in part is read
    without that part (as `nvsdata.open(..., strict=False)` does), what can't be read at all is replaced. Each is
    warned of once; `damaged()` tells of all so far, those that workers met included. 100 in a row that can't be read
    raise in any case.
    """

    samples: list[Any]
    classes: list[str]
    independent: ClassVar[tuple[str, ...]] = ()  # cached properties that don't depend on which samples there are

    def _set(
        self, transform: Transform | None, target_transform: Transform | None, seed: int | None, errors: str
    ) -> None:
        """Settings that say how samples are given; ValueError or TypeError for those that make no sense."""
        check_choice("errors", errors, ERRORS)
        if transform is not None and not callable(transform):
            raise TypeError(f"transform must be callable, not {transform!r}; T.Compose([...]) calls several in a row")
        self.transform, self.target_transform = transform, target_transform
        self.seed, self.errors = seed, errors

    def _count(self) -> None:
        """Set what goes by the number of samples."""
        self.targets = [sample.label for sample in self.samples]
        self._damage = None if self.errors == "raise" else Damage(len(self.samples))
        self._passes = None if self.seed is None else Passes(len(self.samples))

    def subset(self, indices: Iterable[int]) -> Self:
        """The dataset with the samples at `indices` only, in that order."""
        part = copy(self)
        part.samples = [self.samples[index] for index in indices]
        for name in list(vars(part)):
            # what was worked out from the samples
            if isinstance(getattr(type(self), name, None), cached_property) and name not in self.independent:
                del vars(part)[name]
        part._count()
        return part

    @abstractmethod
    def recording(self, index: int) -> Recording:
        """The recording of a sample, opened but not decoded."""

    def recording_names(self) -> list[str]:
        """The recordings that the samples are of, each once, by their path below the root."""
        return list(self.files_of(self.samples))

    def files_of(self, samples: Iterable[Any]) -> dict[str, None]:
        """Paths below the root of what samples are read from, each once, in order."""
        return dict.fromkeys(name for sample in samples for name in self._files(sample))

    def recordings(self, index: int) -> tuple[Recording, ...]:
        """The recordings that a sample is made of, opened but not decoded."""
        return (self.recording(index),)

    def joined(self, parts: Sequence[Any]) -> Any:
        """The sample, of what its recordings became."""
        return parts[0]

    def _files(self, sample: Any) -> tuple[str, ...]:
        """Paths below the root of what a sample is read from."""
        return (sample.name,)

    def _name_of(self, sample: Any) -> str:
        """What tells a sample from others of its class, wherever its file lies."""
        return sample.stem if sample.window is None else "{} {}-{}".format(sample.stem, *sample.window)

    @cached_property
    def names(self) -> list[tuple[str, str]]:
        """Class and name of each sample: what random splits go by. They don't depend on folders or the split."""
        return [(self.classes[sample.label], self._name_of(sample)) for sample in self.samples]

    @cached_property
    def split_hash(self) -> str:
        """16 hex digits that are the same for the same samples, by class, name and label, in a folder or a store."""
        return split_hash((*name, label) for name, label in zip(self.names, self.targets, strict=True))

    def __len__(self) -> int:
        return len(self.samples)

    def __getitem__(self, index: Any) -> Any:
        if isinstance(index, slice):
            return self.subset(range(len(self))[index])
        if self._damage is None and self._passes is None:
            return self._made(index)
        return self.taken(range(len(self))[index], self._made)

    def taken(self, index: int, make: Callable[[int], Any]) -> Any:
        """`make(index)`, with the random numbers that `seed` gives it, and what `errors` puts in place of it."""
        if self._passes is not None and self.seed is not None:
            with seeded(self.seed, self._passes.next(index), index):
                return self._sound(index, make)
        return self._sound(index, make)

    def _sound(self, index: int, make: Callable[[int], Any]) -> Any:
        return make(index) if self._damage is None else self._damage.first_sound(index, make)

    def _made(self, index: int) -> tuple[Any, Any]:
        recordings = self.recordings(index)
        change = self.transform or as_events
        sample = self.joined([change(recording) for recording in recordings])
        self.note_repairs(index, recordings)
        return sample, self.target(index)

    def target(self, index: int) -> Any:
        """The target of a sample."""
        label = self.targets[index]
        return label if self.target_transform is None else self.target_transform(label)

    def note_repairs(self, index: int, recordings: Sequence[Recording]) -> bool:
        """Whether its recordings, once read, say that they were repaired; the sample is counted then."""
        repaired = any(recording.repairs for recording in recordings)
        if self._damage is not None and repaired:
            self._damage.mark(index, REPAIRED, f"{self._files(self.samples[index])[0]}: {_repairs(recordings)}")
        return repaired

    @property
    def num_damaged(self) -> int:
        """How many samples were found damaged so far, in all workers."""
        return 0 if self._damage is None else len(self._damage.found())

    def damaged(self) -> dict[str, str]:
        """What was found damaged so far, in all workers: a sample's recordings to what was done, and why.

        Empty for `errors="raise"`. The reasons are found by reading those recordings once more.
        """
        found = {} if self._damage is None else self._damage.found()
        return {" ".join(self._files(self.samples[i])): self._reason(i, what == REPAIRED) for i, what in found.items()}

    def _reason(self, index: int, repaired: bool) -> str:
        try:
            recordings = self.recordings(index)
            for recording in recordings:
                recording.read()
        except UNREADABLE as error:
            return f"replaced: {error}"
        return f"repaired: {_repairs(recordings)}" if repaired else "replaced, but it can be read now"


def check_choice(name: str, given: Any, choices: Sequence[str]) -> None:
    """ValueError unless it is one of the choices; TypeError for a transform in its place."""
    if callable(given):
        raise TypeError(f"{name} must be {', '.join(map(repr, choices))}; say transform={given!r} by its name")
    if given not in choices:
        raise ValueError(f"{name} must be {', '.join(map(repr, choices))}, not {given!r}")


def _repairs(recordings: Sequence[Recording]) -> str:
    return ", ".join(f"{count} {what}" for recording in recordings for what, count in recording.repairs.items())
