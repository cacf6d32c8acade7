"""Datasets, transforms and models for event cameras.

The names below are imported when they are first used: `import nvsdata` alone costs nothing.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from nvsdata._version import __version__ as __version__

if TYPE_CHECKING:
    from nvsdata import datasets, emulation, formats, metrics, models, transforms
    from nvsdata.common.errors import FormatError
    from nvsdata.data.batching import collate
    from nvsdata.data.events import Events
    from nvsdata.data.graph import Graph, GraphBatch
    from nvsdata.data.recording import Recording
    from nvsdata.datasets import (
        ASLANDVS,
        ASLDVS,
        CIFAR10DVS,
        HMDB51DVS,
        MNISTDVS,
        NCARS,
        NMNIST,
        UCF50DVS,
        UCF101DVS,
        YUPENNDVS,
        DVS128Gesture,
        EventFolder,
        NCaltech101,
    )
    from nvsdata.datasets.cache import cache
    from nvsdata.datasets.store.writer import pack
    from nvsdata.emulation import PIX2NVS
    from nvsdata.formats import open, read, write

_HOMES = {
    "Events": "data.events",
    "Recording": "data.recording",
    "FormatError": "common.errors",
    "open": "formats",
    "read": "formats",
    "write": "formats",
    "ASLANDVS": "datasets",
    "ASLDVS": "datasets",
    "CIFAR10DVS": "datasets",
    "HMDB51DVS": "datasets",
    "MNISTDVS": "datasets",
    "NCARS": "datasets",
    "NMNIST": "datasets",
    "UCF50DVS": "datasets",
    "UCF101DVS": "datasets",
    "YUPENNDVS": "datasets",
    "DVS128Gesture": "datasets",
    "EventFolder": "datasets",
    "NCaltech101": "datasets",
    "Graph": "data.graph",
    "GraphBatch": "data.graph",
    "collate": "data.batching",
    "cache": "datasets.cache",
    "pack": "datasets.store.writer",
    "PIX2NVS": "emulation",
}
_MODULES = ("datasets", "emulation", "formats", "metrics", "models", "transforms")

__all__ = [
    "ASLANDVS",
    "ASLDVS",
    "CIFAR10DVS",
    "HMDB51DVS",
    "MNISTDVS",
    "NCARS",
    "NMNIST",
    "PIX2NVS",
    "UCF50DVS",
    "UCF101DVS",
    "YUPENNDVS",
    "DVS128Gesture",
    "EventFolder",
    "Events",
    "FormatError",
    "Graph",
    "GraphBatch",
    "NCaltech101",
    "Recording",
    "cache",
    "collate",
    "datasets",
    "emulation",
    "formats",
    "metrics",
    "models",
    "open",
    "pack",
    "read",
    "transforms",
    "write",
]


def __getattr__(name: str) -> Any:
    if name in _MODULES:
        return import_module(f"nvsdata.{name}")
    if name not in _HOMES:
        raise AttributeError(f"module 'nvsdata' has no attribute {name!r}")
    # kept: the next use finds it without coming here
    value = globals()[name] = getattr(import_module(f"nvsdata.{_HOMES[name]}"), name)
    return value


def __dir__() -> list[str]:
    return sorted({*__all__, *globals()})
