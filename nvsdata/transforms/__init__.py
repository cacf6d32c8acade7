"""Composable transforms: frozen dataclasses of settings with `__call__`, and a plain function for each.

Random transforms draw from torch's default generator, so they follow `torch.manual_seed` and a DataLoader's worker
seeds.
"""

from nvsdata.transforms.boxes import WithBoxes
from nvsdata.transforms.compose import Compose, Each
from nvsdata.transforms.events.causal_filters import (
    FirstOfBoxes,
    RateLimit,
    RefractoryPeriod,
    first_of_each_box,
    limit_rate,
    refractory_period,
)
from nvsdata.transforms.events.crops import Crop, Downsample, crop_events, downsample, resize_events
from nvsdata.transforms.events.filters import BackgroundActivity, HotPixels, background_activity, drop_hot_pixels
from nvsdata.transforms.events.noise import (
    DropByArea,
    DropByTime,
    RandomRun,
    SpatialJitter,
    UniformNoise,
    add_noise,
    drop_interval,
    drop_rectangle,
    jitter_space,
)
from nvsdata.transforms.events.polarity import MergePolarities, RandomPolarityFlip, SelectPolarity, flip_polarity
from nvsdata.transforms.events.sampling import DropEvents, NonUniformSample, drop, nonuniform_sample
from nvsdata.transforms.events.times import (
    RandomTimeFlip,
    RandomTimeScale,
    RelativeTime,
    TimeJitter,
    flip_time,
    jitter_time,
    relative_time,
    scale_time,
)
from nvsdata.transforms.events.windows import RandomWindow, Volumes, Window, random_window, volumes, window
from nvsdata.transforms.graphs.augment import (
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
from nvsdata.transforms.graphs.edges import KNNGraph, RadiusGraph, knn_graph, radius_graph
from nvsdata.transforms.graphs.features import Age, MergePixels, NodeFeatures, Patch, PatchMean, merge_pixels
from nvsdata.transforms.graphs.grid import Graph2Grid, graph2grid
from nvsdata.transforms.parse import from_repr
from nvsdata.transforms.pipeline_window import longest_window, window_length, with_window_length
from nvsdata.transforms.random_apply import RandomApply, RandomChoice
from nvsdata.transforms.registry import TRANSFORMS, register_transform
from nvsdata.transforms.tensors.active_focus import TAF, taf
from nvsdata.transforms.tensors.averaged_surfaces import HATS, hats
from nvsdata.transforms.tensors.bags import BagOfEvents, bag_of_events, bag_weights
from nvsdata.transforms.tensors.cascades import FilterCascade, filter_cascade
from nvsdata.transforms.tensors.event_frames import ToFrames, to_frames
from nvsdata.transforms.tensors.flow_image import FourChannels, four_channels
from nvsdata.transforms.tensors.frames import (
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
from nvsdata.transforms.tensors.histograms import (
    MixedDensityStack,
    StackedHistogram,
    mixed_density_stack,
    stacked_histogram,
)
from nvsdata.transforms.tensors.image import (
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
from nvsdata.transforms.tensors.latest import TORE, tore
from nvsdata.transforms.tensors.leaky import LeakyFrame, leaky_frame
from nvsdata.transforms.tensors.log_polar import DART, dart
from nvsdata.transforms.tensors.ordered import ERGO12, ergo12
from nvsdata.transforms.tensors.point_sets import Points, points
from nvsdata.transforms.tensors.surfaces import EventSurfaces, TimeSurface, event_surfaces, time_surface
from nvsdata.transforms.tensors.tokens import GroupTokens, group_tokens
from nvsdata.transforms.tensors.voxels import VoxelGrid, voxel_grid

__all__ = [
    "DART",
    "ERGO12",
    "HATS",
    "TAF",
    "TORE",
    "TRANSFORMS",
    "Age",
    "BackgroundActivity",
    "BagOfEvents",
    "CenterCrop",
    "Compose",
    "Crop",
    "Downsample",
    "DropByArea",
    "DropByTime",
    "DropEvents",
    "Each",
    "EventImage",
    "EventSurfaces",
    "FilterCascade",
    "FirstOfBoxes",
    "FourChannels",
    "FourCrops",
    "Graph2Grid",
    "GroupTokens",
    "HotPixels",
    "KNNGraph",
    "LeakyFrame",
    "MedianDenoise",
    "MergePixels",
    "MergePolarities",
    "MixedDensityStack",
    "MotionCrop",
    "NodeFeatures",
    "NonUniformSample",
    "Normalize",
    "Patch",
    "PatchMean",
    "Points",
    "RadiusGraph",
    "RandomAffine",
    "RandomApply",
    "RandomChoice",
    "RandomCrop",
    "RandomFlip",
    "RandomHorizontalFlip",
    "RandomPolarityFlip",
    "RandomRotate",
    "RandomRun",
    "RandomScale",
    "RandomTemporalCrop",
    "RandomTimeFlip",
    "RandomTimeScale",
    "RandomTranslate",
    "RandomWindow",
    "RateLimit",
    "RefractoryPeriod",
    "RelativeTime",
    "Resize",
    "SelectPolarity",
    "SpatialJitter",
    "StackedHistogram",
    "Stacks",
    "SumFrames",
    "TimeJitter",
    "TimeSurface",
    "ToFrames",
    "UniformNoise",
    "Volumes",
    "VoxelGrid",
    "Window",
    "WithBoxes",
    "add_noise",
    "affine",
    "background_activity",
    "bag_of_events",
    "bag_weights",
    "center_crop",
    "crop",
    "crop_events",
    "dart",
    "downsample",
    "drop",
    "drop_hot_pixels",
    "drop_interval",
    "drop_rectangle",
    "ergo12",
    "event_image",
    "event_surfaces",
    "filter_cascade",
    "first_of_each_box",
    "flip",
    "flip_polarity",
    "flip_time",
    "four_channels",
    "four_crops",
    "from_repr",
    "graph2grid",
    "group_tokens",
    "hats",
    "jitter_space",
    "jitter_time",
    "knn_graph",
    "leaky_frame",
    "limit_rate",
    "longest_window",
    "median_denoise",
    "merge_pixels",
    "mixed_density_stack",
    "motion_crop",
    "nonuniform_sample",
    "normalize",
    "points",
    "radius_graph",
    "random_window",
    "refractory_period",
    "register_transform",
    "relative_time",
    "resize",
    "resize_events",
    "rotate",
    "scale",
    "scale_time",
    "shift",
    "stacked_histogram",
    "stacks",
    "sum_frames",
    "taf",
    "time_surface",
    "to_frames",
    "tore",
    "volume",
    "volumes",
    "voxel_grid",
    "window",
    "window_length",
    "with_window_length",
]

for _kind in [thing for thing in list(globals().values()) if isinstance(thing, type)]:
    register_transform(_kind)
