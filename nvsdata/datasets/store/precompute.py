"""Precomputing: the samples of a dataset after the deterministic transforms of its pipeline, in one file."""

from __future__ import annotations

import os
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np

from nvsdata.datasets.base import EventDataset
from nvsdata.datasets.cache.cached import options_of, settings_key
from nvsdata.datasets.facts import Sample
from nvsdata.datasets.precomputed import Precomputed
from nvsdata.datasets.store.index import Precomputing
from nvsdata.datasets.store.part import JournalLine
from nvsdata.datasets.store.sample import sample_of, sample_record
from nvsdata.datasets.store.writing import Made, StoreWriter
from nvsdata.transforms.compose import Compose, head_and_tail

TIMED = 30  # samples that are made and read once more to compare the times


@dataclass(frozen=True)
class PrecomputeReport:
    """Result of `precompute`.

    Attributes:
        samples: number of samples in the file.
        bytes: size of their records.
        skipped: samples that were left out, name to reason.
        head: the transforms that were applied.
        tail: the other transforms of the pipeline, for `Precomputed(..., transform=tail)`.
        making: median time to make a sample, in µs; None for a shard.
        reading: median time to read it from the file, in µs; None for a shard.
    """

    samples: int
    bytes: int
    skipped: dict[str, str]
    head: Compose
    tail: Compose
    making: float | None
    reading: float | None


def precompute(
    dataset: EventDataset,
    out: str | os.PathLike[str],
    *,
    jobs: int = 1,
    scheduler: str | None = None,
    overwrite: bool = False,
    shard: tuple[int, int] | None = None,
) -> PrecomputeReport:
    """Write the samples of `dataset` after the deterministic transforms at the beginning of its pipeline into `out`.

    `Precomputed(out, transform=...)` reads them, and applies the other transforms, such as augmentation, and a
    `target_transform`: labels are stored without the dataset's. Samples whose recording can't be read are left out and
    reported. An interrupted run resumes, as of `pack`.

    Precomputing pays if making a sample takes longer than reading it, such as for graphs of many nodes. The report
    has both times. For windows of events, small graphs and frames, it usually doesn't: use a packed store.

    Args:
        dataset: the dataset; its `transform` is the pipeline.
        out: path of the new file.
        jobs: number of processes.
        scheduler: address of a Dask cluster that makes the samples in place of local processes.
        overwrite: whether to replace an existing file.
        shard: (i, n), with i from 1 to n: every n-th sample from the i-th on, into `out-i-of-n`; see `pack`.

    Returns:
        The numbers, the times of some samples, and what was left out.

    Raises:
        FileExistsError: `out` exists, unless `overwrite`.
        OutputInUse: another process writes `out`.
        OSError: the disk is full; `out` doesn't appear.
        ValueError: the pipeline doesn't begin with a deterministic transform, or the dataset has `transforms`.
            Or two samples are the same part of a recording.
        TypeError: a transform doesn't show its settings, or returns something that can't be stored; see `cache`. Or
            samples are pairs of recordings, or targets are boxes.

    Example:
        >>> import tempfile, nvsdata
        >>> from pathlib import Path
        >>> from nvsdata import transforms as T
        >>> root = Path(tempfile.mkdtemp())
        >>> (root / "data/waving").mkdir(parents=True)
        >>> _ = nvsdata.write(nvsdata.example(), root / "data/waving/0.npy")
        >>> pipeline = T.Compose([T.Window(0, 20_000), T.RadiusGraph(), T.RandomFlip()])
        >>> report = nvsdata.precompute(nvsdata.EventFolder(root / "data", transform=pipeline), root / "graphs.nvs")
        >>> report.samples, report.tail
        (1, Compose([RandomFlip(axis=0, p=0.5)]))
        >>> graph, label = nvsdata.Precomputed(root / "graphs.nvs", transform=report.tail)[0]
    """
    head, tail = head_and_tail(dataset.transform)
    _check(dataset, head, tail)
    items = {sample.name + sample.part: sample for sample in dataset.samples}
    place = {name: position for position, name in enumerate(items)}

    def sections(names: Sequence[str]) -> dict[str, Any]:
        samples = [items[name] for name in names]
        labels, parts = [sample.label for sample in samples], [sample.part for sample in samples]
        return {"label": labels, "part": parts, "position": [place[name] for name in names]}

    writer = StoreWriter(
        dataset,
        items=items,
        files=lambda name: items[name].name,
        make=partial(_made, _without_samples(dataset), head),
        intact=_is_intact,
        what=f"precomputing {dataset.info.name}",
        shared=_settings(dataset, head),
        facts={"precomputed": Precomputing(repr(head), dataset.classes)._asdict()},
        sections=sections,
    )
    target = Path(out).expanduser()
    part = writer.write(target, jobs=jobs, scheduler=scheduler, overwrite=overwrite, shard=shard)
    times = (None, None) if shard is not None else _times(dataset, head, target)
    return PrecomputeReport(len(part.facts), sum(line.length for line in part.facts), part.skipped, head, tail, *times)


def _check(dataset: EventDataset, head: Compose, tail: Compose) -> None:
    """Raise ValueError or TypeError unless the samples can be precomputed."""
    if dataset.transforms is not None:
        raise ValueError("precompute stores what `transform` returns, and this dataset has `transforms`")
    if not head.transforms:
        first = f"begins with {tail.transforms[0]!r}, which isn't deterministic" if tail.transforms else "is empty"
        raise ValueError(f"nothing to precompute: the pipeline {first}")
    if not all(isinstance(sample, Sample) for sample in dataset.samples):
        raise TypeError(f"samples of {dataset.info.name} are pairs of recordings: use nvsdata.cache")
    if getattr(dataset, "boxes", False):
        raise TypeError("only labels are stored, and the targets of this dataset are boxes: use nvsdata.cache")
    if (twice := Counter(sample.name + sample.part for sample in dataset.samples).most_common(1)) and twice[0][1] > 1:
        raise ValueError(f"{twice[0][0]} is a sample {twice[0][1]} times: precompute it once, and then use `subset`")


def _settings(dataset: EventDataset, head: Compose) -> list[str]:
    """Return what the samples depend on, in addition to their recordings."""
    options = [f"{name}={value}" for name, value in options_of(dataset) if name != "root"]
    if dataset.errors == "repair":
        options.append("repaired")
    return [*options, *map(settings_key, head.transforms)]


def _without_samples(dataset: EventDataset) -> EventDataset:
    """Return the dataset for other processes, without the names of all recordings and without transforms."""
    small = dataset.subset(())
    small.samples = []
    # they aren't called, and functions can't be sent to a process
    small.transform = small.target_transform = None
    for name in ("listing", "_recordings"):
        vars(small).pop(name, None)
    small.skipped = []
    return small


def _made(dataset: EventDataset, head: Compose, sample: Sample) -> Made:
    """Return line and record of a sample, or the reason why there is none."""
    try:
        stamp = dataset.source.stamp(sample.name) if sample.name not in dataset.source.left_out else ()
        record = sample_record(head(dataset.part(sample)))
    except (OSError, ValueError) as error:
        return str(error)
    name, check = sample.name + sample.part, int.from_bytes(record[:4], "little")
    return JournalLine(name, 0, len(record), check, dataset.source.size(sample.name), list(stamp)), record


def _is_intact(raw: np.ndarray, line: JournalLine) -> bool:
    try:
        sample_of(raw, line.check)
    except ValueError:
        return False
    return True


def _times(dataset: EventDataset, head: Compose, target: Path) -> tuple[float, float]:
    """Return the median times to make a sample and to read it, in µs."""
    found = Precomputed(target)
    making, reading = [], []
    for index in range(0, len(found), -(-len(found) // TIMED)):
        begin = time.perf_counter()
        head(dataset.part(found.samples[index]))
        made = time.perf_counter()
        found[index]
        reading.append(time.perf_counter() - made)
        making.append(made - begin)
    return 1e6 * median(making), 1e6 * median(reading)
