"""Composable transforms: frozen settings with `__call__`, and a plain function beside each.

Random ones draw from torch's default generator, so `torch.manual_seed` and a DataLoader's worker
seeding govern them.
"""

from nvsdata.transforms.augment import (
    RandomAffine,
    RandomFlip,
    RandomRotate,
    RandomScale,
    RandomShift,
    affine,
    flip,
    rotate,
    scale,
    shift,
)
from nvsdata.transforms.compose import Compose
from nvsdata.transforms.graph import RadiusGraph, radius_graph
from nvsdata.transforms.sample import NonUniformSample, RandomDrop, drop, nonuniform_sample
from nvsdata.transforms.window import RandomWindow, Window, random_window, window

__all__ = [
    "Compose",
    "NonUniformSample",
    "RadiusGraph",
    "RandomAffine",
    "RandomDrop",
    "RandomFlip",
    "RandomRotate",
    "RandomScale",
    "RandomShift",
    "RandomWindow",
    "Window",
    "affine",
    "drop",
    "flip",
    "nonuniform_sample",
    "radius_graph",
    "random_window",
    "rotate",
    "scale",
    "shift",
    "window",
]
