"""A dataset whose samples are kept on disk, and the key that identifies them."""

from __future__ import annotations

import hashlib
import os
import re
import time
import types
import warnings
from collections.abc import Sequence
from dataclasses import fields, is_dataclass
from enum import Enum
from functools import cached_property, partial
from itertools import chain
from pathlib import Path, PurePath
from typing import Any

import numpy as np
import torch
from torch import nn
from torch.utils.data import Dataset, Subset

from nvsdata._version import __version__
from nvsdata.common.errors import shown
from nvsdata.common.files import atomic, put, remove_link, sealed, sweep, unsealed
from nvsdata.data.recording import as_events
from nvsdata.datasets.base import EventDataset
from nvsdata.datasets.cache.encoding import MOST, TooLarge, decode_sample, encode_sample
from nvsdata.datasets.source import CACHE_TAG
from nvsdata.transforms.compose import head_and_tail

TAG = b"Signature: 8a477f597d28d172789f06886806bc55\n# made by nvsdata.cache; what is here can be made again\n"
SHARD = 1000  # samples per folder
# attributes of a dataset that don't change the samples in the cache
IGNORED = (
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
DERIVED = ("source", "class_to_idx", "samples", "targets", "skipped")
PLAIN = (type(None), bool, int, float, complex, str, bytes, PurePath, Enum, torch.dtype, torch.device, np.dtype)
ADDRESS = re.compile(r"\bat 0x[0-9a-f]+", re.IGNORECASE)
FUNCTIONS = (
    types.FunctionType,
    types.BuiltinFunctionType,
    types.MethodType,
    types.BuiltinMethodType,
    np.ufunc,
    partial,
)


def cache(dataset: EventDataset, path: str | os.PathLike[str]) -> Cached:
    """Return the dataset with the output of its first, deterministic transforms stored below `path`.

    The output of the pipeline's first transforms with `deterministic = True` is stored (`Window`, `RadiusGraph`, and
    your own transforms that declare it). The transforms after them, such as augmentation, are called each time. The key
    of the cache consists of the names of the samples, the dataset's options and the settings of the cached transforms:
    if one of them changes, all samples are made again. A sample is also made again if the size or modification time of
    its file has changed. A change in the code of your own transforms isn't detected: empty the folder then.

    Several workers and processes may share a cache: each file appears complete or not at all. Unfinished files of
    killed processes are removed when a cache is opened. If the disk is full or not writable, each process warns once,
    and makes samples again each time.

    Args:
        dataset: a dataset whose `transform` is the pipeline.
        path: folder of the cache, made if needed; several caches may share it.

    Returns:
        A dataset of the same samples and targets.

    Raises:
        ValueError: the pipeline begins with a transform that isn't deterministic, or the dataset has `transforms`.
        TypeError: a cached transform doesn't show its settings (it is neither a dataclass nor has its own `__repr__`).
            Also when a sample is read that isn't made of Events, graphs, tensors, arrays, numbers, strings, and
            tuples, lists and dicts of them.

    Example:
        >>> import tempfile, nvsdata
        >>> from nvsdata import transforms as T
        >>> from pathlib import Path
        >>> root = Path(tempfile.mkdtemp())
        >>> (root / "data/waving").mkdir(parents=True)
        >>> _ = nvsdata.write(nvsdata.example(), root / "data/waving/0.npy")
        >>> cached = nvsdata.cache(nvsdata.EventFolder(root / "data", transform=T.Window(0, 30_000)), root / "cache")
        >>> cached[0][0] == cached[0][0]
        True
    """
    return Cached(dataset, Path(path).expanduser())


class Cached(Dataset[tuple[Any, Any]]):
    """A dataset that reads from disk the samples that it has made before; see `cache`."""

    def __init__(self, dataset: EventDataset, path: Path) -> None:
        if dataset.transforms is not None:
            raise ValueError("a cache keeps what `transform` returns, and this dataset has `transforms`")
        self.dataset, (self.head, self.tail) = dataset, head_and_tail(dataset.transform)
        if self.tail.transforms and not self.head.transforms:
            first = self.tail.transforms[0]
            raise ValueError(f"nothing to keep: the pipeline begins with {first!r}, which isn't deterministic")
        key = "\n".join((__version__, *_identity(dataset), *map(settings_key, self.head.transforms)))
        self.folder = path / hashlib.sha256(key.encode("utf-8", "surrogatepass")).hexdigest()[:16]
        self._full = False
        if self.folder.is_dir():
            sweep(self.folder)

    def __len__(self) -> int:
        return len(self.dataset)

    def __getitem__(self, index: Any) -> Any:
        if isinstance(index, slice):
            return Subset(self, range(len(self))[index])
        return self.dataset.seeded_sample(range(len(self))[index], self._made)

    def set_epoch(self, epoch: int) -> None:
        """Set the epoch of random numbers; see `Samples.set_epoch`."""
        self.dataset.set_epoch(epoch)

    def state_dict(self) -> dict[str, Any]:
        """Return the state of the random numbers; see `Samples.state_dict`."""
        return self.dataset.state_dict()

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Continue with the random numbers of a state; see `Samples.load_state_dict`."""
        self.dataset.load_state_dict(state)

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
            # a file changed just now may change again with the same stamp; repaired recordings are counted each time
            if not (self._full or repaired) and all(
                self.dataset.source.settled(name, at) for name in self._files(index)
            ):
                self._keep(parts, stamps, file)
        return self.dataset.combine([self.tail(part) for part in parts]), self.dataset.target(index)

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
            # training continues; this process no longer tries to write
            self._full = True
            message = f"{self.folder} can't be written to, samples are made again each time: {error}"
            warnings.warn(shown(message), stacklevel=2)

    def __getattr__(self, name: str) -> Any:
        if name == "dataset":  # while it is unpickled
            raise AttributeError(name)
        return getattr(self.dataset, name)

    def __repr__(self) -> str:
        return f"{self.dataset!r}\n    cached: {self.head!r} in {shown(self.folder)}"


def _save(parts: list[Any], stamps: list[list[int]], file: Path) -> None:
    try:
        content = encode_sample([stamps, parts])
    except TooLarge:
        return  # the sample is made again each time
    for folder in (file.parent.parent, file.parent):
        remove_link(folder)
    file.parent.mkdir(parents=True, exist_ok=True)
    with atomic(file) as temporary, temporary.open("wb") as out:
        out.write(sealed(content))
        out.write(content)


def _load(file: Path, stamps: list[list[int]]) -> list[Any] | None:
    """Return the stored parts of a sample; None if they are missing, damaged, or of other versions of the files."""
    content = unsealed(file, MOST)
    if content is None:
        return None
    try:
        found, parts = decode_sample(content)
    except (ValueError, TypeError):
        return None  # the sample is made again
    # a part for each file, or two parts if both recordings of a pair are in one file
    return parts if found == stamps and isinstance(parts, list) and len(parts) >= len(stamps) else None


def _identity(dataset: EventDataset) -> Sequence[str]:
    """Return strings that distinguish datasets: class, options and a hash of the samples."""
    digest = hashlib.sha256()
    for sample in dataset.samples:
        digest.update(repr(sample).encode("utf-8", "surrogatepass"))
    return type(dataset).__module__, type(dataset).__qualname__, repr(options_of(dataset)), digest.hexdigest()


def options_of(dataset: EventDataset) -> list[tuple[str, str]]:
    """Return the options of a dataset on which its samples depend, and its root: sorted names, and keys of values."""
    return sorted(
        (name, settings_key(value))
        for name, value in vars(dataset).items()
        if name not in (*IGNORED, *DERIVED)
        # and not a cached value, which isn't an option
        and not isinstance(getattr(type(dataset), name, None), cached_property)
    )


def settings_key(thing: Any) -> str:
    """Return a string that is the same in every process, and differs if the settings of `thing` differ.

    It consists of class and fields for a dataclass, and of class and `__repr__` for anything else.

    Raises:
        TypeError: the thing doesn't show its settings. It is a function; its `__repr__` is that of `object`, of
            `torch.nn.Module`, or of a base class of the one that defines `__init__`; or the `__repr__` contains an
            address or is shortened ("...").
    """
    if isinstance(thing, PLAIN):
        return f"{type(thing).__qualname__} {thing!r}"
    if isinstance(thing, torch.Tensor):
        content = thing.detach().cpu().contiguous().view(-1).view(torch.uint8).numpy().tobytes()
        return f"{type(thing).__qualname__} {thing.dtype} {thing.shape} {hashlib.sha256(content).hexdigest()}"
    if isinstance(thing, np.ndarray | np.generic):
        values = np.asarray(thing)
        content = np.ascontiguousarray(values).tobytes()
        digest = settings_key(values.tolist()) if values.dtype.hasobject else hashlib.sha256(content).hexdigest()
        return f"{type(thing).__qualname__} {values.dtype} {values.shape} {digest}"
    if isinstance(thing, type):
        return f"class {thing.__module__}.{thing.__qualname__}"
    name = f"{type(thing).__module__}.{type(thing).__qualname__}"
    if isinstance(thing, list | tuple):
        return f"{name}[{', '.join(map(settings_key, thing))}]"
    if isinstance(thing, set | frozenset):
        return f"{name}[{', '.join(sorted(map(settings_key, thing)))}]"
    if isinstance(thing, dict):
        return f"{name}[{', '.join(f'{settings_key(key)}: {settings_key(value)}' for key, value in thing.items())}]"
    if isinstance(thing, FUNCTIONS):
        raise TypeError(_advice(thing, "is a function, whose settings aren't visible"))
    if is_dataclass(thing):
        settings = {field.name: getattr(thing, field.name, None) for field in fields(thing)}
        # and attributes that aren't fields, such as those that a subclass sets
        settings |= getattr(thing, "__dict__", {})
        return f"{name}({', '.join(f'{setting}={settings_key(value)}' for setting, value in settings.items())})"
    if isinstance(thing, nn.Module):
        return f"{name}: {_module_key(thing)}"
    text = repr(thing)
    if _hides_settings(type(thing), "__repr__", object) or ADDRESS.search(text) or "..." in text:
        raise TypeError(_advice(thing, "has a repr that doesn't show its settings"))
    return f"{name}: {text}"


def _module_key(module: nn.Module) -> str:
    if _inherits(module, nn.Module):
        if any(True for _ in chain(module.parameters(), module.buffers())):
            raise TypeError(_advice(module, "has weights, which its repr doesn't show"))
        for part in module.modules():
            hides = _inherits(part, nn.Module) and _hides_settings(type(part), "extra_repr", nn.Module)
            if hides and not isinstance(part, nn.Sequential | nn.ModuleList | nn.ModuleDict):
                raise TypeError(_advice(part, "is a Module without an extra_repr that shows its settings"))
    return repr(module)


def _inherits(thing: Any, base: type, method: str = "__repr__") -> bool:
    """Return whether the method of `thing` is that of the class `base`, not overridden."""
    return getattr(type(thing), method) is getattr(base, method)


def _hides_settings(kind: type, method: str, base: type) -> bool:
    """Return whether `method` can't show the settings of a class.

    That is so if it is the method of `base`, or if a class below the one that defines it has an `__init__` of its own.
    """
    for one in kind.__mro__:
        if method in vars(one):
            return one is base
        if "__init__" in vars(one) and one is not base:
            return True
    return True


def _advice(thing: Any, what: str) -> str:
    return (
        f"{thing!r} {what}, so a cache can't distinguish it from others: make it a dataclass whose fields are its "
        "settings, or give its class a __repr__ that names them"
    )
