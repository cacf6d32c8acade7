"""Datasets of event recordings, torchvision-style.

To add one, write a module with its class and add its line to `DATASETS`.
"""

from __future__ import annotations

from difflib import get_close_matches

from nvsdata.datasets.aslandvs import ASLANDVS
from nvsdata.datasets.asldvs import ASLDVS
from nvsdata.datasets.base import EventDataset, plain
from nvsdata.datasets.cifar10dvs import CIFAR10DVS
from nvsdata.datasets.dvs128gesture import DVS128Gesture
from nvsdata.datasets.folder import EventFolder
from nvsdata.datasets.hmdb51dvs import HMDB51DVS
from nvsdata.datasets.mnistdvs import MNISTDVS
from nvsdata.datasets.ncaltech101 import NCaltech101
from nvsdata.datasets.ncars import NCARS
from nvsdata.datasets.nmnist import NMNIST
from nvsdata.datasets.seeded import SeededBatches, SeededDataset
from nvsdata.datasets.splits import stratified
from nvsdata.datasets.ucf import UCF50DVS, UCF101DVS
from nvsdata.datasets.yupenndvs import YUPENNDVS

DATASETS: dict[str, type[EventDataset]] = {
    kind.info.name: kind
    for kind in (
        NMNIST,
        NCaltech101,
        MNISTDVS,
        CIFAR10DVS,
        NCARS,
        ASLDVS,
        DVS128Gesture,
        UCF50DVS,
        UCF101DVS,
        HMDB51DVS,
        ASLANDVS,
        YUPENNDVS,
        EventFolder,
    )
}


def dataset_named(name: str) -> type[EventDataset]:
    """The dataset of a name, which may be that of the table ("n-mnist") or of the class ("NMNIST"), in any case.

    ValueError, with those that come close, if there is none.
    """
    names = {plain(known): kind for kind in DATASETS.values() for known in (kind.info.name, kind.__name__)}
    kind = names.get(plain(name))
    if kind is None:
        close = dict.fromkeys(names[found].info.name for found in get_close_matches(plain(name), names, cutoff=0.5))
        hint = f"did you mean {' or '.join(close)}?" if close else f"there are {', '.join(DATASETS)}"
        raise ValueError(f"no dataset {name!r}; {hint}")
    return kind


__all__ = [
    "ASLANDVS",
    "ASLDVS",
    "CIFAR10DVS",
    "DATASETS",
    "HMDB51DVS",
    "MNISTDVS",
    "NCARS",
    "NMNIST",
    "UCF50DVS",
    "UCF101DVS",
    "YUPENNDVS",
    "DVS128Gesture",
    "EventDataset",
    "EventFolder",
    "NCaltech101",
    "SeededBatches",
    "SeededDataset",
    "dataset_named",
    "stratified",
]
