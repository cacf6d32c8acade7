"""Training and test data, in batches whose random samples depend only on seed, epoch and index."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from copy import copy
from dataclasses import dataclass
from itertools import islice
from typing import Any, ClassVar

from torch.utils.data import DataLoader, Sampler

from nvsdata.common.processes import end_with_parent
from nvsdata.common.signals import ENDING
from nvsdata.data.batching import collate
from nvsdata.data.events import Events
from nvsdata.datasets import ASLANDVS, EventFolder, SeededBatches, SeededDataset, dataset_named, stratified
from nvsdata.datasets.sample_blocks import SampleBlocks
from nvsdata.datasets.seeded import Key
from nvsdata.training.processes import Team
from nvsdata.transforms.events.crops import resize_events
from nvsdata.transforms.events.windows import after_window, window_length


def loader(
    dataset: Any,
    batch: int,
    team: Team,
    *,
    seed: int = 0,
    first: int = 0,
    last: int = 1,
    start: int = 0,
    shuffle: bool = False,
    blocks: SampleBlocks | None = None,
    whole_batches: bool = False,
) -> DataLoader[Any]:
    """Return a loader of the batches of epochs `first` to `last` - 1, of which each process loads its part.

    Args:
        dataset: Dataset of `(sample, target)`.
        batch: Samples per batch, over all processes.
        team: The processes that share the batches.
        seed: Seed of order and random numbers, which depend only on seed, epoch and sample (default 0).
        first: First epoch (default 0).
        last: End of the epochs, exclusive (default 1).
        start: Number of batches of the first epoch to leave out (default 0).
        shuffle: True for a random order in each epoch (default False).
        blocks: Blocks of the random order; see `SeededBatches` (default None).
        whole_batches: False (default) to divide each batch among the processes, for training. True to divide the
            batches: of n processes, each loads every n-th batch. Outputs of a network are then bit-identical for any
            number of processes, because rounding depends on the batch; see `predict`.

    Returns:
        A DataLoader.

    Example:
        >>> import torch
        >>> from nvsdata import training
        >>> dataset = [(torch.zeros(3), 0), (torch.ones(3), 1)]
        >>> len(training.loader(dataset, 2, training.Team(torch.device("cpu"))))
        1
    """
    seeded = SeededDataset(dataset, seed)
    part = (0, 1) if whole_batches else (team.rank, team.count)
    epochs: dict[str, Any] = {"first": first, "last": last, "start": start, "shuffle": shuffle, "seed": seed}
    epochs["blocks"] = blocks
    batches = SeededBatches(len(dataset), batch, **epochs, part=part, remainder="keep")
    return DataLoader(
        seeded,
        batch_sampler=_EveryNth(batches, team) if whole_batches else batches,
        num_workers=team.workers,
        collate_fn=collate,
        persistent_workers=True,
        worker_init_fn=_begin_worker,
    )


class _EveryNth(Sampler[list[Key]]):
    """The batches rank, rank + n, rank + 2 n, ... of a single process, for each of n processes."""

    def __init__(self, batches: SeededBatches, team: Team) -> None:
        self.batches, self.team = batches, team

    def __len__(self) -> int:
        return len(range(self.team.rank, len(self.batches), self.team.count))

    def __iter__(self) -> Iterator[list[Key]]:
        return islice(self.batches, self.team.rank, None, self.team.count)


def _begin_worker(_: int) -> None:
    # otherwise, the workers of a killed training would continue, and keep its folder locked
    end_with_parent()
    for number in ENDING:
        # the loader ends its workers by signals, and Python's handlers would wait for a running kernel
        signal.signal(number, signal.SIG_DFL)


class TrainTestSplit:
    """Recordings of a dataset for training, validation and testing.

    The split between training and testing is the dataset's own. If it has none, a random fifth of each class is for
    testing.

    Args:
        name: Name of the dataset.
        root: Folder of the dataset, or path or URL of the file that `nvsdata pack` made of it.
        fold: Number of the split (default None: the dataset's default).
        seed: Seed of a random split, stored in `data` (default 0).
        validate: Approximate fraction of the training recordings to hold out for validation (default 0: none). The
            selection doesn't depend on a seed; see `hold_out` of the dataset.
        errors: Handling of damaged recordings, as for datasets (default "raise").
        test_from: Name and root of another dataset of the same classes to test on: on its test recordings, or on all if
            it has no test split. Their windows are scaled to the sensor of the training recordings (default None: the
            same dataset).

    Raises:
        ValueError: For a dataset of pairs, if `validate` leaves a class without recordings, or if the dataset of
            `test_from` has other classes.
        FileNotFoundError: If there are no recordings.

    Example:
        >>> import tempfile
        >>> from pathlib import Path
        >>> import nvsdata
        >>> from nvsdata import training
        >>> events = nvsdata.Events([0], [1], [2], [1], sensor_size=(4, 4))
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     (Path(folder) / "cats").mkdir()
        ...     for name in "abcde":
        ...         _ = nvsdata.write(events, Path(folder) / "cats" / f"{name}.aedat4")
        ...     split = training.TrainTestSplit("folder", Path(folder))
        ...     len(split.train(None)), len(split.test(None)), split.classes
        (4, 1, ['cats'])
    """

    def __init__(
        self,
        name: str,
        root: str | os.PathLike[str],
        *,
        fold: int | None = None,
        seed: int = 0,
        validate: float = 0.0,
        errors: str = "raise",
        test_from: tuple[str, str | os.PathLike[str]] | None = None,
    ) -> None:
        kind = _kind_named(name)
        try:
            self._train, self._test = (kind(root, split, fold=fold, errors=errors) for split in ("train", "test"))
        except FileNotFoundError:
            split = "all" if kind is EventFolder else "train"
            whole = kind(root, split, fold=fold, errors=errors)
            self._train, self._test = map(whole.subset, stratified(whole.names, 0.2, seed=seed))
        if test_from is not None:
            self._test = _tested(*test_from, errors=errors)
            _check_classes((name, self._train.classes), (test_from[0], self._test.classes))
        self._test_from, self._validation = test_from, None
        if validate:
            self._train, self._validation = self._train.hold_out(validate)
        self.classes: list[str] = self._train.classes
        self.sensor_size: tuple[int, int] = self._train.sensor_size or (240, 180)
        self._resized = _ToSensor(*self.sensor_size) if test_from is not None and self._train.sensor_size else None
        self.data = data_of(self._train, self._test, seed)
        if test_from is not None:
            self.data["test_dataset"] = test_from[0]
        if self._validation is not None:
            self.data |= {"validate": validate, "validation_hash": self._validation.split_hash}

    def train(self, transform: Any) -> Any:
        """Return the training dataset with a transform."""
        return _with(self._train, transform)

    def validation(self, transform: Any) -> Any:
        """Return the validation dataset with a transform; None without one."""
        return None if self._validation is None else _with(self._validation, transform)

    def test(self, transform: Any) -> Any:
        """Return the test dataset with a transform.

        With `test_from`, random windows of the transform are scaled to the sensor of the training data.
        """
        if self._resized is not None and window_length(transform) is not None:
            transform = after_window(transform, self._resized)
        return _with(self._test, transform)

    def overlap(self) -> dict[str, str]:
        """Find test recordings that are also training or validation recordings, under any name.

        Files of equal size are compared by a hash of their bytes, recordings of a packed store by their checksums.

        Returns:
            Paths of these test recordings, and for each the path of the same recording in the other parts. Paths are
            relative to the root.
        """
        parts = [part for part in (self._train, self._validation) if part is not None]
        source, trained = self._test.source, self._train.source
        sizes = {name: trained.size(name) for part in parts for name in part.recording_names()}
        tested = {name: source.size(name) for name in self._test.recording_names()}
        shared = {*sizes.values()} & {*tested.values()}
        known = {trained.content(name): name for name, size in sizes.items() if size in shared}
        same = {name: known.get(source.content(name)) for name, size in tested.items() if size in shared}
        # a file of one name in both parts of a dataset has different windows or labeled parts in each
        one_dataset = self._test_from is None
        return {name: other for name, other in same.items() if other and not (one_dataset and other == name)}


@dataclass(frozen=True)
class _ToSensor:
    """Scale events to a sensor of another size."""

    width: int
    height: int
    deterministic: ClassVar[bool] = True

    def __call__(self, events: Events) -> Events:
        return resize_events(events, self.width, self.height)


def _kind_named(name: str) -> Any:
    """Return the class of a dataset whose recordings have classes."""
    kind: Any = dataset_named(name)
    if issubclass(kind, ASLANDVS):
        raise ValueError(f"{name} consists of pairs of recordings, not of classes: see recipes/similarity_aslan.py")
    return kind


def _tested(name: str, root: str | os.PathLike[str], *, errors: str) -> Any:
    """Return the test recordings of a dataset, or all if it has no test split."""
    kind = _kind_named(name)
    try:
        return kind(root, "test", errors=errors)
    except FileNotFoundError:
        return kind(root, "all", errors=errors)


def _check_classes(trained: tuple[str, list[str]], tested: tuple[str, list[str]]) -> None:
    """ValueError if the classes of two datasets, each with its name, or their orders, differ."""
    if trained[1] == tested[1]:
        return
    pairs = ((trained, tested), (tested, trained))
    only = [
        f"only {a} has {', '.join(found)}" for (a, own), (_, other) in pairs if (found := sorted({*own} - {*other}))
    ]
    difference = "; ".join(only) or "their order differs"
    raise ValueError(f"{tested[0]} can't test networks for the classes of {trained[0]}: {difference}")


def _with(dataset: Any, transform: Any) -> Any:
    """Return a copy of a dataset with another transform, without listing its files again."""
    changed = copy(dataset)
    changed.transform = transform
    return changed


def data_of(train: Any, test: Any, seed: int) -> dict[str, Any]:
    """Describe the data for `Trainer`.

    Args:
        train: Training dataset.
        test: Test dataset.
        seed: Seed of the run.

    Returns:
        A dictionary of dataset, split, fold, seed and the hashes of both sets.

    Example:
        >>> from types import SimpleNamespace
        >>> from nvsdata import training
        >>> cats = SimpleNamespace(info=SimpleNamespace(name="cats"), split_name="train", fold=0, split_hash="f00d")
        >>> sorted(training.data_of(cats, cats, seed=0))
        ['dataset', 'fold', 'hash', 'seed', 'split', 'test_hash']
    """
    hashes = {"hash": train.split_hash, "test_hash": test.split_hash}
    return {"dataset": train.info.name, "split": train.split_name, "fold": train.fold, "seed": seed, **hashes}
