"""What is drawn at random in a pipeline."""

from dataclasses import fields, is_dataclass

from torch.utils.data import ConcatDataset

from nvsdata import transforms as T
from nvsdata.transforms.compose import is_deterministic

# a window of a recording; and of each window, which of its events are looked at
CHOICES = T.RandomWindow, T.RandomTemporalCrop, T.RandomWindows, T.NonUniformSample, T.Points


def leaves(transform):
    """The transforms that a pipeline is made of, however deep."""
    values = [getattr(transform, field.name) for field in fields(transform)] if is_dataclass(transform) else []
    parts = [part for value in values for part in (value if isinstance(value, list | tuple) else [value])]
    inner = [part for part in parts if callable(part)]
    return [leaf for part in inner for leaf in leaves(part)] if inner else [transform]


def changes(transform):
    """What of it changes a sample at random, beside the choice of a window and of events."""
    return [leaf for leaf in leaves(transform) if not isinstance(leaf, CHOICES) and not is_deterministic(leaf)]


def transforms_of(dataset):
    """The transforms of a dataset, or of those that it is made of."""
    if isinstance(dataset, ConcatDataset):
        return [transform for part in dataset.datasets for transform in transforms_of(part)]
    return [dataset.transform] if hasattr(dataset, "transform") else transforms_of(dataset.dataset)
