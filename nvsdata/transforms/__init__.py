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
from nvsdata.transforms.compose import Compose, Each
from nvsdata.transforms.frames import (
    FourCrops,
    MedianDenoise,
    MotionCrop,
    RandomVolume,
    Stacks,
    SumFrames,
    four_crops,
    median_denoise,
    motion_crop,
    stacks,
    sum_frames,
    volume,
)
from nvsdata.transforms.graph import NearestGraph, RadiusGraph, nearest_graph, radius_graph
from nvsdata.transforms.grid import Graph2Grid, graph2grid
from nvsdata.transforms.image import (
    CentreCrop,
    EventImage,
    Normalise,
    RandomCrop,
    RandomMirror,
    Resize,
    centre_crop,
    crop,
    event_image,
    normalise,
    resize,
)
from nvsdata.transforms.parse import from_repr
from nvsdata.transforms.points import Points, points
from nvsdata.transforms.registry import TRANSFORMS, register_transform
from nvsdata.transforms.sample import NonUniformSample, RandomDrop, drop, nonuniform_sample
from nvsdata.transforms.window import RandomWindow, Volumes, Window, random_window, volumes, window

__all__ = [
    "TRANSFORMS",
    "CentreCrop",
    "Compose",
    "Each",
    "EventImage",
    "FourCrops",
    "Graph2Grid",
    "MedianDenoise",
    "MotionCrop",
    "NearestGraph",
    "NonUniformSample",
    "Normalise",
    "Points",
    "RadiusGraph",
    "RandomAffine",
    "RandomCrop",
    "RandomDrop",
    "RandomFlip",
    "RandomMirror",
    "RandomRotate",
    "RandomScale",
    "RandomShift",
    "RandomVolume",
    "RandomWindow",
    "Resize",
    "Stacks",
    "SumFrames",
    "Volumes",
    "Window",
    "affine",
    "centre_crop",
    "crop",
    "drop",
    "event_image",
    "flip",
    "four_crops",
    "from_repr",
    "graph2grid",
    "median_denoise",
    "motion_crop",
    "nearest_graph",
    "nonuniform_sample",
    "normalise",
    "points",
    "radius_graph",
    "random_window",
    "register_transform",
    "resize",
    "rotate",
    "scale",
    "shift",
    "stacks",
    "sum_frames",
    "volume",
    "volumes",
    "window",
]

for _kind in [thing for thing in list(globals().values()) if isinstance(thing, type)]:
    register_transform(_kind)
