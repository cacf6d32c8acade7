"""Base classes and helpers that several datasets share: random splits, and the DAVIS240C datasets of Bi et al."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from nvsdata.data.recording import Recording
from nvsdata.data.views import FlippedY
from nvsdata.datasets.base import EventDataset
from nvsdata.datasets.facts import Sample
from nvsdata.datasets.sample_list import taken
from nvsdata.datasets.splits import stratified


class RandomSplitDataset(EventDataset):
    """A dataset that is published without a split: a random fifth of each class is for testing.

    `fold` is the seed of the split. A seed's split is the same on every machine, because it depends only on the names
    of the recordings in a class, not on folders, other classes or the files' format. Adding or removing a recording
    changes the split of at most one other recording.
    """

    def _check_fold(self, fold: int | None) -> int:
        if fold is not None and fold < 0:
            raise ValueError(f"fold, the seed of the random split, must be at least 0, not {fold}")
        return fold or 0

    def _select(self, found: Sequence[Sample]) -> Iterable[Sample]:
        if self.split_name in ("all", self.source.split) or not found:
            return found
        names = [(self.classes[sample.label], self._name_of(sample)) for sample in found]
        train, test = stratified(names, 0.2, seed=self.fold)
        return taken(found, train if self.split_name == "train" else test)


class BottomOriginDataset(EventDataset):
    """A dataset whose .mat files count y from the bottom of the sensor; nvsdata counts from the top."""

    def _view(self, recording: Recording) -> Recording:
        return FlippedY(recording) if recording.format == "matlab" else recording


def numbered_fold(fold: int | None, folds: Sequence[int], default: int) -> int:
    """Return the fold, or the default for None; ValueError unless it is one of `folds`."""
    if fold is not None and fold not in folds:
        raise ValueError(f"fold must be {folds[0]} to {folds[-1]}, not {fold}")
    return default if fold is None else fold


def google_drive(file: str) -> str:
    """Return the address of a file on Google Drive that skips the page about virus scanning."""
    return f"https://drive.usercontent.google.com/download?id={file}&export=download&confirm=t"
