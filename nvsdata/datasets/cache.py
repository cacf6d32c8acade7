"""What the deterministic head of a pipeline gives, kept on disk."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch.utils.data import Dataset

from nvsdata import __version__
from nvsdata.datasets.base import EventDataset
from nvsdata.events import Columns, Events
from nvsdata.files import atomic
from nvsdata.graph import Graph
from nvsdata.transforms.compose import Compose

SHARD = 1000  # samples a folder


class Cached(Dataset[tuple[Any, Any]]):
    """A dataset whose samples are taken from disk where they were made before; see `cache`."""

    def __init__(self, dataset: EventDataset, path: Path) -> None:
        steps = _steps(dataset.transform)
        cut = next((i for i, step in enumerate(steps) if not getattr(step, "deterministic", False)), len(steps))
        if steps and not cut:
            raise ValueError(f"nothing to keep: the pipeline begins with {steps[0]!r}, which isn't deterministic")
        self.dataset, self.head, self.tail = dataset, Compose(steps[:cut]), Compose(steps[cut:])
        key = "\n".join((__version__, *_identity(dataset), repr(self.head)))
        self.folder = path / hashlib.sha256(key.encode()).hexdigest()[:16]

    def __len__(self) -> int:
        return len(self.dataset)

    def __getitem__(self, index: int) -> tuple[Any, Any]:
        index = range(len(self))[index]
        file = self.folder / str(index // SHARD) / f"{index}.pt"
        sample = _load(file)
        if sample is None:
            recording = self.dataset.recording(index)
            sample = self.head(recording if self.head.transforms else recording.read())
            _save(sample, file)
        label = self.dataset.targets[index]
        change = self.dataset.target_transform
        return self.tail(sample), label if change is None else change(label)

    def __getattr__(self, name: str) -> Any:
        if name == "dataset":  # while it is unpickled
            raise AttributeError(name)
        return getattr(self.dataset, name)

    def __repr__(self) -> str:
        return f"{self.dataset!r}\n    cached: {self.head!r} in {self.folder}"


def cache(dataset: EventDataset, path: str | os.PathLike[str]) -> Cached:
    """The dataset, with what its pipeline's deterministic head gives kept below `path`.

    The head are the first transforms that have `deterministic = True` (`Window`, `RadiusGraph`, and
    your own that say so); what follows, such as augmentation, is called each time. What is kept
    belongs to the dataset's files, its options and the head's repr: change one and it is made anew.
    Several workers and processes may share a cache: files appear whole.

    ValueError if the pipeline begins with a transform that isn't deterministic.
    """
    return Cached(dataset, Path(path))


def _steps(transform: Callable[[Any], Any] | None) -> list[Callable[[Any], Any]]:
    if transform is None:
        return []
    return list(transform.transforms) if isinstance(transform, Compose) else [transform]


def _identity(dataset: EventDataset) -> Sequence[str]:
    """What tells one dataset from another: class, options, and the samples it has, with their files' sizes."""
    options = {k: v for k, v in vars(dataset).items() if isinstance(v, str | int | bool | Path | tuple | None)}
    digest = hashlib.sha256()
    for sample in dataset.samples:
        digest.update(repr(sample).encode())
    for name in dataset.recording_names():
        digest.update(dataset.source.size(name).to_bytes(8, "little"))
    return type(dataset).__qualname__, repr(sorted(options.items())), digest.hexdigest()


def _save(sample: Any, file: Path) -> None:
    kept = _plain(sample)
    file.parent.mkdir(parents=True, exist_ok=True)
    with atomic(file) as temporary:
        torch.save(kept, temporary)


def _load(file: Path) -> Any:
    """What was kept, None if nothing was or it can't be read."""
    try:
        return _restored(torch.load(file, weights_only=True))
    except FileNotFoundError:
        return None
    except Exception:  # whatever a damaged file brings about: it is made anew
        return None


def _plain(sample: Any) -> Any:
    """The sample in tensors, numbers, lists and dicts, which are safe to load."""
    if isinstance(sample, Events):
        return {"events": sample.torch(), "sensor_size": sample.sensor_size, "start": sample.start}
    if isinstance(sample, Graph):
        return {"graph": {field.name: getattr(sample, field.name) for field in fields(sample)}}
    if isinstance(sample, list | tuple):
        return {"list": [_plain(item) for item in sample]}
    if isinstance(sample, torch.Tensor):
        return {"tensor": sample}
    if isinstance(sample, np.ndarray):
        return {"array": torch.from_numpy(sample)}
    raise TypeError(f"a cache keeps Events, graphs, tensors, arrays and lists of them, not {type(sample).__name__}")


def _restored(kept: dict[str, Any]) -> Any:
    ((kind, value),) = [item for item in kept.items() if item[0] not in ("sensor_size", "start")]
    if kind == "events":
        columns = Columns(*(value[name].numpy() for name in ("t", "x", "y", "p")))
        return Events.trusted(columns, kept["sensor_size"], kept["start"])
    if kind == "graph":
        return Graph(**value)
    if kind == "list":
        return [_restored(item) for item in value]
    return value.numpy() if kind == "array" else value
