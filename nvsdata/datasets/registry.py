"""The registry of datasets by name."""

from __future__ import annotations

from difflib import get_close_matches
from typing import TypeVar

from nvsdata.common.registry import Registry
from nvsdata.common.text import plain_name
from nvsdata.datasets.base import EventDataset

Kind = TypeVar("Kind", bound=type[EventDataset])

DATASETS: Registry[type[EventDataset]] = Registry("dataset", "datasets", lambda _, kind: register_dataset(kind))


def register_dataset(kind: Kind) -> Kind:
    """Register a dataset under `info.name` for all commands and recipes; to be used as a class decorator.

    A package can use an entry point instead (group `nvsdata.datasets`, whose object is the class).

    Args:
        kind: the dataset's class.

    Returns:
        The class.

    Raises:
        ValueError: another dataset has that name, or a similar one.
        TypeError: `kind` isn't a subclass of EventDataset with an `info`.

    Example:
        >>> from nvsdata.datasets import EventDataset, dataset_named, register_dataset
        >>> from nvsdata.datasets.facts import Info
        >>> @register_dataset
        ... class Cups(EventDataset):
        ...     info = Info("cups", sensor_size=(128, 128), classes=("cup", "mug"), page="", license="CC0")
        >>> dataset_named("cups").__name__
        'Cups'
    """
    if not (isinstance(kind, type) and issubclass(kind, EventDataset) and hasattr(kind, "info")):
        raise TypeError(f"register_dataset takes a subclass of EventDataset with an `info`, not {kind!r}")
    for known in DATASETS.loaded():
        alike = {plain_name(kind.info.name), plain_name(kind.__name__)} & {
            plain_name(known.info.name),
            plain_name(known.__name__),
        }
        if alike and known.info.name != kind.info.name:
            raise ValueError(f"there is a dataset {known.info.name!r} already, {known!r}: choose another name")
    return DATASETS.register(kind.info.name, kind)  # type: ignore[return-value]


def dataset_named(name: str) -> type[EventDataset]:
    """Return the class of a dataset.

    Args:
        name: its `info.name` ("n-mnist") or the name of the class ("NMNIST"), in any case.

    Raises:
        ValueError: there is no such dataset; the message lists similar names.

    Example:
        >>> from nvsdata.datasets import dataset_named
        >>> dataset_named("n-mnist").info.sensor_size
        (34, 34)
    """
    names = {plain_name(known): kind for kind in DATASETS.values() for known in (kind.info.name, kind.__name__)}
    kind = names.get(plain_name(name))
    if kind is None:
        close = dict.fromkeys(
            names[found].info.name for found in get_close_matches(plain_name(name), names, cutoff=0.5)
        )
        hint = f"did you mean {' or '.join(close)}?" if close else f"there are {', '.join(DATASETS)}"
        raise ValueError(f"no dataset {name!r}; {hint}")
    return kind
