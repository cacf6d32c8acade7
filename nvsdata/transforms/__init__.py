"""Composable transforms: frozen dataclasses of settings with `__call__`.

Random transforms use torch's default generator, so they follow `torch.manual_seed` and a DataLoader's worker seeds.
"""

from typing import TYPE_CHECKING

from nvsdata.transforms.boxes import WithBoxes
from nvsdata.transforms.compose import Compose, Each, RandomApply, RandomChoice
from nvsdata.transforms.events.causal_filters import FirstOfBoxes, RateLimit, RefractoryPeriod
from nvsdata.transforms.events.corners import Corners
from nvsdata.transforms.events.crops import Crop, Downsample, resize_events
from nvsdata.transforms.events.filters import BackgroundActivity, HotPixels
from nvsdata.transforms.events.noise import SpatialJitter, UniformNoise
from nvsdata.transforms.events.polarity import MergePolarities, RandomPolarityFlip, SelectPolarity
from nvsdata.transforms.events.sampling import DropByArea, DropByTime, DropEvents, NonUniformSample, RandomRun
from nvsdata.transforms.events.times import RandomTimeFlip, RandomTimeScale, RelativeTime, TimeJitter
from nvsdata.transforms.events.undistort import Undistort
from nvsdata.transforms.events.windows import (
    RandomWindow,
    RandomWindows,
    Window,
    longest_window,
    window_length,
    with_window_length,
)
from nvsdata.transforms.graphs.augment import (
    Center,
    RandomAffine,
    RandomFlip,
    RandomRotate,
    RandomScale,
    RandomTranslate,
    affine,
)
from nvsdata.transforms.graphs.edges import KNNGraph, RadiusGraph
from nvsdata.transforms.graphs.features import Age, MergePixels, NodeFeatures, Patch, PatchMean, TimeBins
from nvsdata.transforms.graphs.grid import Graph2Grid
from nvsdata.transforms.registry import TRANSFORMS, from_repr, register_transform
from nvsdata.transforms.tensors.active_focus import TAF
from nvsdata.transforms.tensors.averaged_surfaces import HATS
from nvsdata.transforms.tensors.bags import BagOfEvents, bag_weights
from nvsdata.transforms.tensors.cascades import FilterCascade
from nvsdata.transforms.tensors.event_frames import ToFrames
from nvsdata.transforms.tensors.flow import PlaneFlow
from nvsdata.transforms.tensors.frames import FourCrops, MedianDenoise, MotionCrop, RandomTemporalCrop, SlidingClips
from nvsdata.transforms.tensors.histograms import MixedDensityStack, StackedHistogram
from nvsdata.transforms.tensors.image import CenterCrop, EventImage, Normalize, RandomCrop, Resize
from nvsdata.transforms.tensors.latest import TORE, FourChannels
from nvsdata.transforms.tensors.leaky import LeakyFrame
from nvsdata.transforms.tensors.log_polar import DART
from nvsdata.transforms.tensors.ordered import ERGO12
from nvsdata.transforms.tensors.point_sets import Points
from nvsdata.transforms.tensors.surfaces import EventSurfaces, TimeSurface
from nvsdata.transforms.tensors.tokens import GroupTokens
from nvsdata.transforms.tensors.voxels import VoxelGrid

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
    "Center",
    "CenterCrop",
    "Compose",
    "Corners",
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
    "PlaneFlow",
    "Points",
    "RadiusGraph",
    "RandomAffine",
    "RandomApply",
    "RandomChoice",
    "RandomCrop",
    "RandomFlip",
    "RandomPolarityFlip",
    "RandomRotate",
    "RandomRun",
    "RandomScale",
    "RandomTemporalCrop",
    "RandomTimeFlip",
    "RandomTimeScale",
    "RandomTranslate",
    "RandomWindow",
    "RandomWindows",
    "RateLimit",
    "RefractoryPeriod",
    "RelativeTime",
    "Resize",
    "SelectPolarity",
    "SlidingClips",
    "SpatialJitter",
    "StackedHistogram",
    "TimeBins",
    "TimeJitter",
    "TimeSurface",
    "ToFrames",
    "Undistort",
    "UniformNoise",
    "VoxelGrid",
    "Window",
    "WithBoxes",
    "affine",
    "bag_weights",
    "from_repr",
    "longest_window",
    "register_transform",
    "resize_events",
    "window_length",
    "with_window_length",
]

# names that other libraries have for these
_ELSEWHERE = {
    "ToFrame": "ToFrames(bins=...) or ToFrames(duration=...)",
    "ToVoxelGrid": "VoxelGrid(bins)",
    "ToTimesurface": "TimeSurface(tau)",
    "ToAveragedTimesurface": "HATS()",
    "ToImage": "EventImage()",
    "Denoise": "BackgroundActivity(duration)",
    "EventDrop": "DropEvents, DropByTime or DropByArea",
    "DropEvent": "DropEvents(fraction)",
    "DropPixel": "HotPixels",
    "RandomFlipLR": "RandomFlip()",
    "RandomHorizontalFlip": "RandomFlip()",
    "MergePolarity": "MergePolarities()",
}


if not TYPE_CHECKING:  # which would take any name for known

    def __getattr__(name: str) -> object:
        ours = f"; it is {_ELSEWHERE[name]} here" if name in _ELSEWHERE else ""
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}{ours}")


for _kind in [thing for thing in list(globals().values()) if isinstance(thing, type)]:
    register_transform(_kind)
