"""Training and test data, in batches whose random samples depend only on seed, epoch and index."""

from __future__ import annotations

import signal
from copy import copy
from pathlib import Path
from typing import Any

from torch.utils.data import DataLoader

from nvsdata.common.processes import end_with_parent
from nvsdata.common.signals import ENDING
from nvsdata.data.batching import collate
from nvsdata.datasets import ASLANDVS, EventFolder, SeededBatches, SeededDataset, dataset_named, stratified
from nvsdata.training.processes import Team


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
) -> DataLoader[Any]:
    """Return a loader of the batches of epochs `first` to `last` - 1; each process loads its part of every batch.

    Args:
        dataset: Dataset of `(sample, target)`.
        batch: Samples per batch, over all processes.
        team: The processes that share each batch.
        seed: Seed of order and random numbers, which depend only on seed, epoch and sample (default 0).
        first: First epoch (default 0).
        last: End of the epochs, exclusive (default 1).
        start: Number of batches of the first epoch to leave out (default 0).
        shuffle: True for a random order in each epoch (default False).

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
    part = team.rank, team.count
    epochs: dict[str, Any] = {"first": first, "last": last, "start": start, "shuffle": shuffle, "seed": seed}
    batches = SeededBatches(len(dataset), batch, **epochs, part=part, remainder="keep")
    return DataLoader(
        seeded,
        batch_sampler=batches,
        num_workers=team.workers,
        collate_fn=collate,
        persistent_workers=True,
        worker_init_fn=_begin_worker,
    )


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
        root: Folder of the dataset, or the file that `nvsdata pack` made of it.
        fold: Number of the split (default None: the dataset's default).
        seed: Seed of a random split, stored in `data` (default 0).
        validate: Approximate fraction of the training recordings to hold out for validation (default 0: none). The
            selection doesn't depend on a seed; see `hold_out` of the dataset.
        errors: Handling of damaged recordings, as for datasets (default "raise").

    Raises:
        ValueError: For a dataset of pairs, or if `validate` leaves a class without recordings.
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
        root: Path,
        *,
        fold: int | None = None,
        seed: int = 0,
        validate: float = 0.0,
        errors: str = "raise",
    ) -> None:
        kind: Any = dataset_named(name)
        if issubclass(kind, ASLANDVS):
            raise ValueError(f"{name} consists of pairs of recordings, not of classes: see recipes/similarity_aslan.py")
        try:
            self._train, self._test = (kind(root, split, fold=fold, errors=errors) for split in ("train", "test"))
        except FileNotFoundError:
            split = "all" if kind is EventFolder else "train"
            whole = kind(root, split, fold=fold, errors=errors)
            self._train, self._test = map(whole.subset, stratified(whole.names, 0.2, seed=seed))
        self._validation = None
        if validate:
            self._train, self._validation = self._train.hold_out(validate)
        self.classes: list[str] = self._train.classes
        self.sensor_size: tuple[int, int] = self._train.sensor_size or (240, 180)
        self.data = data_of(self._train, self._test, seed)
        if self._validation is not None:
            self.data |= {"validate": validate, "validation_hash": self._validation.split_hash}

    def train(self, transform: Any) -> Any:
        """Return the training dataset with a transform."""
        return _with(self._train, transform)

    def validation(self, transform: Any) -> Any:
        """Return the validation dataset with a transform; None without one."""
        return None if self._validation is None else _with(self._validation, transform)

    def test(self, transform: Any) -> Any:
        """Return the test dataset with a transform."""
        return _with(self._test, transform)

    def overlap(self) -> dict[str, str]:
        """Find test recordings that are also training or validation recordings, under any name.

        Files of equal size are compared by a hash of their bytes, recordings of a packed store by their checksums.

        Returns:
            Paths of these test recordings, and for each the path of the same recording in the other parts. Paths are
            relative to the root.
        """
        parts = [part for part in (self._train, self._validation) if part is not None]
        source = self._test.source
        sizes = {name: source.size(name) for part in parts for name in part.recording_names()}
        tested = {name: source.size(name) for name in self._test.recording_names()}
        shared = {*sizes.values()} & {*tested.values()}
        known = {source.content(name): name for name, size in sizes.items() if size in shared}
        same = {name: known.get(source.content(name), name) for name, size in tested.items() if size in shared}
        # a file of one name in both has different windows or labeled parts in each
        return {name: other for name, other in same.items() if other != name}


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
