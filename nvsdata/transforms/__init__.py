"""Composable transforms: frozen dataclasses of settings with `__call__`, and a plain function for each.

Random transforms draw from torch's default generator, so they follow `torch.manual_seed` and a DataLoader's worker
seeds.
"""

from nvsdata.transforms.augment import (
    RandomAffine,
    RandomFlip,
    RandomRotate,
    RandomScale,
    RandomTranslate,
    affine,
    flip,
    rotate,
    scale,
    shift,
)
from nvsdata.transforms.averaged_surfaces import HATS, hats
from nvsdata.transforms.compose import Compose, Each
from nvsdata.transforms.event_frames import ToFrames, to_frames
from nvsdata.transforms.features import Age, MergePixels, NodeFeatures, Patch, PatchMean, merge_pixels
from nvsdata.transforms.flow_image import FourChannels, four_channels
from nvsdata.transforms.frames import (
    FourCrops,
    MedianDenoise,
    MotionCrop,
    RandomTemporalCrop,
    Stacks,
    SumFrames,
    four_crops,
    median_denoise,
    motion_crop,
    stacks,
    sum_frames,
    volume,
)
from nvsdata.transforms.graph import KNNGraph, RadiusGraph, knn_graph, radius_graph
from nvsdata.transforms.grid import Graph2Grid, graph2grid
from nvsdata.transforms.image import (
    CenterCrop,
    EventImage,
    Normalize,
    RandomCrop,
    RandomHorizontalFlip,
    Resize,
    center_crop,
    crop,
    event_image,
    normalize,
    resize,
)
from nvsdata.transforms.leaky import LeakyFrame, leaky_frame
from nvsdata.transforms.lengths import longest_window, window_length, with_window_length
from nvsdata.transforms.parse import from_repr
from nvsdata.transforms.point_sets import Points, points
from nvsdata.transforms.registry import TRANSFORMS, register_transform
from nvsdata.transforms.sample import DropEvents, NonUniformSample, drop, nonuniform_sample
from nvsdata.transforms.surfaces import EventSurfaces, TimeSurface, event_surfaces, time_surface
from nvsdata.transforms.voxels import VoxelGrid, voxel_grid
from nvsdata.transforms.windows import RandomWindow, Volumes, Window, random_window, volumes, window

__all__ = [
    "HATS",
    "TRANSFORMS",
    "Age",
    "CenterCrop",
    "Compose",
    "DropEvents",
    "Each",
    "EventImage",
    "EventSurfaces",
    "FourChannels",
    "FourCrops",
    "Graph2Grid",
    "KNNGraph",
    "LeakyFrame",
    "MedianDenoise",
    "MergePixels",
    "MotionCrop",
    "NodeFeatures",
    "NonUniformSample",
    "Normalize",
    "Patch",
    "PatchMean",
    "Points",
    "RadiusGraph",
    "RandomAffine",
    "RandomCrop",
    "RandomFlip",
    "RandomHorizontalFlip",
    "RandomRotate",
    "RandomScale",
    "RandomTemporalCrop",
    "RandomTranslate",
    "RandomWindow",
    "Resize",
    "Stacks",
    "SumFrames",
    "TimeSurface",
    "ToFrames",
    "Volumes",
    "VoxelGrid",
    "Window",
    "affine",
    "center_crop",
    "crop",
    "drop",
    "event_image",
    "event_surfaces",
    "flip",
    "four_channels",
    "four_crops",
    "from_repr",
    "graph2grid",
    "hats",
    "knn_graph",
    "leaky_frame",
    "longest_window",
    "median_denoise",
    "merge_pixels",
    "motion_crop",
    "nonuniform_sample",
    "normalize",
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
    "time_surface",
    "to_frames",
    "volume",
    "volumes",
    "voxel_grid",
    "window",
    "window_length",
    "with_window_length",
]

for _kind in [thing for thing in list(globals().values()) if isinstance(thing, type)]:
    register_transform(_kind)
