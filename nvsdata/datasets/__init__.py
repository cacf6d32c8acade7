"""Datasets of event recordings, torchvision-style.

`docs/extending.md` shows how to add a dataset.
"""

from __future__ import annotations

from nvsdata.datasets.aslandvs import ASLANDVS
from nvsdata.datasets.asldvs import ASLDVS
from nvsdata.datasets.base import EventDataset
from nvsdata.datasets.cache.encoding import decode_sample
from nvsdata.datasets.cifar10dvs import CIFAR10DVS
from nvsdata.datasets.dvs128gesture import DVS128Gesture
from nvsdata.datasets.folder import EventFolder
from nvsdata.datasets.hmdb51dvs import HMDB51DVS
from nvsdata.datasets.mnistdvs import MNISTDVS
from nvsdata.datasets.ncaltech101 import NCaltech101
from nvsdata.datasets.ncars import NCARS
from nvsdata.datasets.nmnist import NMNIST
from nvsdata.datasets.registry import DATASETS, dataset_named, register_dataset
from nvsdata.datasets.seeded import SeededBatches, SeededDataset
from nvsdata.datasets.sequences import SequenceBatches
from nvsdata.datasets.splits import stratified
from nvsdata.datasets.ucf import UCF50DVS, UCF101DVS
from nvsdata.datasets.yupenndvs import YUPENNDVS

for _kind in (
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
):
    register_dataset(_kind)

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
    "SequenceBatches",
    "dataset_named",
    "decode_sample",
    "register_dataset",
    "stratified",
]
