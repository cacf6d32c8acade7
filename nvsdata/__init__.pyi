from . import compat, datasets, emulation, formats, metrics, models, plots, transforms
from ._version import __version__ as __version__
from .common.errors import FormatError
from .data.batching import collate
from .data.camera_model import CameraModel
from .data.events import Events
from .data.graph import Graph, GraphBatch
from .data.recording import Recording
from .datasets import (
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
    SeededBatches,
    SeededDataset,
    SequenceBatches,
)
from .datasets.cache.cached import cache
from .datasets.precomputed import Precomputed
from .datasets.store.joining import join
from .datasets.store.precompute import precompute
from .datasets.store.writer import pack
from .datasets.windows import windows
from .emulation import PIX2NVS
from .emulation.example import example
from .formats import open, read, write
from .formats.cameras.layouts import read_camera
from .plots.show import plot

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
    "CameraModel",
    "DVS128Gesture",
    "EventFolder",
    "Events",
    "FormatError",
    "Graph",
    "GraphBatch",
    "NCaltech101",
    "Precomputed",
    "Recording",
    "SeededBatches",
    "SeededDataset",
    "SequenceBatches",
    "cache",
    "collate",
    "compat",
    "datasets",
    "emulation",
    "example",
    "formats",
    "join",
    "metrics",
    "models",
    "open",
    "pack",
    "plot",
    "plots",
    "precompute",
    "read",
    "read_camera",
    "transforms",
    "windows",
    "write",
]
