"""Entire recordings as samples, which are made when they are asked for."""

from __future__ import annotations

import operator
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import cached_property
from itertools import chain, pairwise, repeat
from typing import Any, Self, overload

import numpy as np

from nvsdata.datasets.facts import Sample
from nvsdata.datasets.source import Listing, Recordings, recordings_in


class ListedRecordings:
    """The `Recordings` of a listing."""

    def __init__(self, listing: Listing) -> None:
        self._listing = listing
        found = [list(recordings_in({folder: names})) for folder, names in listing.items()]
        self.folders = list(listing)
        self.names = list(chain.from_iterable(found))
        self.folder = np.repeat(np.arange(len(found), dtype=np.uint32), [len(names) for names in found])

    def __reduce__(self) -> tuple[type, tuple[Listing]]:
        # a dataset is sent with its listing anyway, so the names aren't sent twice
        return type(self), (self._listing,)

    def sort(self, numbers: np.ndarray, *, by_file: bool) -> None:
        """Sort numbers of recordings, uint32, in place: by file name, then by folder; otherwise by path."""
        names = [self.names[number] for number in numbers.tolist()]
        keys = [(name.rpartition("/")[2], name) for name in names] if by_file else names
        # sorting is fast where neighbors are in order, as in a folder
        numbers[:] = numbers[sorted(range(len(keys)), key=keys.__getitem__)]


class SampleList(Sequence[Sample]):
    """Samples of entire recordings. Each is made when it is asked for, so a million take no time, and 4 bytes each.

    Args:
        recordings: the recordings.
        labels: label of the recordings in each folder; those of -1 are no samples.
        numbers: number of each sample's recording, uint32 [N].
    """

    def __init__(self, recordings: Recordings, labels: np.ndarray, numbers: np.ndarray) -> None:
        self._recordings, self._by_folder, self._numbers = recordings, labels, numbers

    @classmethod
    def sorted(cls, recordings: Recordings, label_of: Callable[[str], int | None], *, by_file: bool) -> Self:
        """Return the samples, sorted by class, then by file name (or by path).

        Args:
            recordings: the recordings.
            label_of: returns the label of a folder's recordings; None if they are no samples.
            by_file: whether the folders of a class are mixed.
        """
        found = map(label_of, recordings.folders)
        by_folder = np.array([-1 if label is None else label for label in found], np.int32)
        labels = by_folder[recordings.folder]
        order = np.argsort(labels, kind="stable").astype(np.uint32)
        ends = np.cumsum(np.bincount(labels + 1))
        for begin, end in pairwise(ends):
            recordings.sort(order[begin:end], by_file=by_file)
        return cls(recordings, by_folder, order[ends[0] if ends.size else 0 :])

    @cached_property
    def labels(self) -> list[int]:
        """Label of each sample."""
        found: list[int] = self._by_folder[self._recordings.folder[self._numbers]].tolist()
        return found

    def take(self, indices: Iterable[int]) -> Self:
        """Return the samples at some indices, in their order. IndexError beyond the ends."""
        places = np.fromiter(map(range(len(self)).__getitem__, indices), np.int64)
        return type(self)(self._recordings, self._by_folder, self._numbers[places])

    def within(self, is_inside: Callable[[str], bool]) -> Self:
        """Return the samples whose folders fulfill a condition."""
        inside = np.array([is_inside(folder) for folder in self._recordings.folders], np.bool_)
        kept = inside[self._recordings.folder[self._numbers]]
        return type(self)(self._recordings, self._by_folder, self._numbers[kept])

    def __len__(self) -> int:
        return int(self._numbers.size)

    @overload
    def __getitem__(self, index: int) -> Sample: ...

    @overload
    def __getitem__(self, index: slice) -> Self: ...

    def __getitem__(self, index: Any) -> Any:
        if isinstance(index, slice):
            return self.take(range(len(self))[index])
        number = self._numbers[operator.index(index)].item()
        return Sample(self._recordings.names[number], self._by_folder[self._recordings.folder[number]].item())

    def __iter__(self) -> Iterator[Sample]:
        names = map(self._recordings.names.__getitem__, self._numbers.tolist())
        # `_make` is faster than `Sample(...)`
        return map(Sample._make, zip(names, self.labels, repeat(None), repeat(None)))

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Sequence) and len(self) == len(other) and all(map(operator.eq, self, other))

    __hash__ = None  # type: ignore[assignment]

    def __add__(self, other: Iterable[Any]) -> list[Any]:
        return [*self, *other]

    def __radd__(self, other: Iterable[Any]) -> list[Any]:
        return [*other, *self]

    def __repr__(self) -> str:
        return f"<{len(self)} samples>"


def taken(samples: Sequence[Any], indices: Iterable[int]) -> Sequence[Any]:
    """Return the samples at some indices."""
    return samples.take(indices) if isinstance(samples, SampleList) else [samples[index] for index in indices]


def labels_of(samples: Sequence[Any]) -> list[int]:
    """Return the label of each sample."""
    return samples.labels if isinstance(samples, SampleList) else [sample.label for sample in samples]
