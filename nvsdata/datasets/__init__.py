"""Datasets of event recordings, torchvision-style.

To add one, write a module with its class and add its line to `DATASETS`.
"""

from __future__ import annotations

from nvsdata.datasets.base import EventDataset
from nvsdata.datasets.folder import EventFolder
from nvsdata.datasets.nmnist import NMNIST
from nvsdata.datasets.seeded import SeededBatches, SeededDataset
from nvsdata.datasets.splits import stratified

__all__ = ["DATASETS", "NMNIST", "EventDataset", "EventFolder", "SeededBatches", "SeededDataset", "stratified"]

DATASETS: dict[str, type[EventDataset]] = {
    "n-mnist": NMNIST,
    "folder": EventFolder,
}
