"""Whole numbers as settings: fractions are refused, and floats that are whole work like ints."""

from functools import partial

import numpy as np
import pytest
import torch

from nvsdata import Events
from nvsdata import transforms as T

EVENTS = Events(np.arange(400) * 500, np.arange(400) * 7 % 60, np.arange(400) * 11 % 40, np.arange(400) % 2, (60, 40))
FRAMES = torch.rand(30, 30, 40, generator=torch.Generator().manual_seed(0))
WHOLE = [
    (T.BagOfEvents, {"count": 30}, EVENTS),
    (T.CenterCrop, {"size": 9}, EVENTS),
    (T.CenterCrop, {"size": 9}, FRAMES),
    (T.Crop, {"x": 1, "y": 2, "width": 30, "height": 20}, EVENTS),
    (T.Downsample, {"factor": 2, "step": 3}, EVENTS),
    (T.FourCrops, {"size": 8}, FRAMES),
    (T.MotionCrop, {"size": 8}, FRAMES),
    (T.Points, {"count": 30}, EVENTS),
    (T.RandomCrop, {"size": 9}, FRAMES),
    (T.RandomRun, {"count": 50}, EVENTS),
    (T.RandomTemporalCrop, {"length": 9}, FRAMES),
    (T.RandomWindow, {"duration": 9_000}, EVENTS),
    (T.Resize, {"size": 20}, EVENTS),
    (T.Resize, {"size": 20}, FRAMES),
    (T.SlidingClips, {"length": 3}, FRAMES),
    (partial(T.ToFrames, 2, values="sum"), {"factor": 3}, EVENTS),
    (T.ToFrames, {"bins": 4}, EVENTS),
    (T.ToFrames, {"count": 40}, EVENTS),
    (T.ToFrames, {"duration": 40_000}, EVENTS),
    (T.UniformNoise, {"count": 50}, EVENTS),
    (T.RandomWindows, {"count": 3, "duration": 9_000}, EVENTS),
    (T.VoxelGrid, {"bins": 4}, EVENTS),
    (T.Window, {"start": 1_000, "stop": 9_000}, EVENTS),
]


def same(a, b):
    if isinstance(a, list):
        return len(a) == len(b) and all(map(same, a, b))
    if isinstance(a, Events):
        return a == b and all(type(side) is int for side in a.sensor_size)
    return torch.equal(a, b)


@pytest.mark.parametrize(("kind", "settings", "sample"), WHOLE, ids=lambda one: getattr(one, "__name__", None))
def test_whole_numbers(kind, settings, sample):
    torch.manual_seed(0)
    expected = kind(**settings)(sample)
    torch.manual_seed(0)
    assert same(kind(**{name: float(value) for name, value in settings.items()})(sample), expected)
    for name, value in settings.items():
        for bad in (value + 0.5, float("nan"), float("inf")):
            with pytest.raises(ValueError, match=name):
                kind(**{**settings, name: bad})


# the least value of a setting, one below, the largest, one above (None: there's no end to it)
BOUNDS = [
    (T.BagOfEvents, "count", 1, 0, None, None, EVENTS),
    (T.CenterCrop, "size", 1, 0, None, None, EVENTS),
    *((T.Crop, name, 0, -1, None, None, EVENTS) for name in ("x", "y")),
    *((T.Crop, name, 1, 0, None, None, EVENTS) for name in ("width", "height")),
    *((T.DART, name, 1, 0, None, None, EVENTS) for name in ("wedges", "queue")),
    (T.DART, "rings", 2, 1, None, None, EVENTS),
    *((T.Downsample, name, 1, 0, None, None, EVENTS) for name in ("factor", "step")),
    (T.EventSurfaces, "radius", 0, -1, None, None, EVENTS),
    *((T.FilterCascade, name, 1, 0, None, None, EVENTS) for name in ("filters", "tick", "decay")),
    (T.FourCrops, "size", 1, 0, None, None, FRAMES),
    (T.GroupTokens, "groups", 2, 0, None, None, EVENTS),
    (T.GroupTokens, "patch", 1, 0, None, None, EVENTS),
    (T.HATS, "cell", 1, 0, None, None, EVENTS),
    (T.HATS, "radius", 0, -1, None, None, EVENTS),
    (T.KNNGraph, "k", 1, 0, None, None, EVENTS),
    (T.MixedDensityStack, "bins", 1, 0, 60, 61, EVENTS),
    (T.MixedDensityStack, "most", 1, 0, None, None, EVENTS),
    (T.MotionCrop, "size", 1, 0, None, None, FRAMES),
    (T.NonUniformSample, "k", 1, 0, None, None, EVENTS),
    *((kind, "size", 1, -1, 17, 19, None) for kind in (T.Patch, T.PatchMean)),
    (T.TimeBins, "bins", 1, 0, None, None, None),
    (T.PlaneFlow, "radius", 1, 0, 8, 9, EVENTS),
    (T.PlaneFlow, "least", 3, 2, None, None, EVENTS),
    (T.Points, "count", 1, 0, None, None, EVENTS),
    (T.RadiusGraph, "alpha", 0, -1, None, None, EVENTS),
    (T.RadiusGraph, "beta", 0, -1, None, None, EVENTS),
    (T.RadiusGraph, "max_degree", 1, 0, None, None, EVENTS),
    (T.RandomAffine, "stretch", 0, -0.5, 0.9, 1, EVENTS),
    *((T.RandomAffine, name, 0, -0.5, None, None, EVENTS) for name in ("degrees", "shift", "shear")),
    (T.RandomCrop, "size", 1, 0, None, None, FRAMES),
    (T.RandomFlip, "axis", 0, -1, 1, 2, EVENTS),
    (T.RandomRun, "count", 1, 0, None, None, EVENTS),
    (T.RandomTemporalCrop, "length", 1, 0, None, None, FRAMES),
    (T.RandomWindow, "within", (0, 0.1), (-0.1, 0.1), (0.9, 1), (0.9, 1.1), EVENTS),
    (T.Resize, "size", 1, 0, None, None, EVENTS),
    (T.SelectPolarity, "polarity", 0, -1, 1, 2, EVENTS),
    *((T.StackedHistogram, name, 1, 0, None, None, EVENTS) for name in ("bins", "most")),
    (T.SlidingClips, "length", 1, 0, None, None, FRAMES),
    (partial(T.ToFrames, 2, values="sum"), "factor", 1, 0, None, None, EVENTS),
    (T.TAF, "depth", 1, 0, None, None, EVENTS),
    (T.TORE, "k", 1, 0, None, None, EVENTS),
    *((T.ToFrames, name, 1, 0, None, None, EVENTS) for name in ("bins", "count")),
    (T.UniformNoise, "count", 0, -1, None, None, EVENTS),
    (T.VoxelGrid, "bins", 1, 0, None, None, EVENTS),
    (T.RandomWindows, "count", 1, 0, None, None, EVENTS),
]
OTHERS = {T.Crop: {"x": 0, "y": 0, "width": 30, "height": 20}}


@pytest.mark.parametrize(
    ("kind", "name", "least", "below", "largest", "above", "sample"),
    BOUNDS,
    ids=[f"{getattr(kind, '__name__', 'sum')}-{name}" for kind, name, *_ in BOUNDS],
)
def test_a_setting_goes_to_its_bounds_and_no_further(kind, name, least, below, largest, above, sample):
    for good in (least, largest):
        if good is not None:
            transform = kind(**{**OTHERS.get(kind, {}), name: good})
            assert transform(*((EVENTS, T.RadiusGraph()(EVENTS)) if sample is None else (sample,))) is not None
    for bad in (below, above):
        if bad is not None:
            with pytest.raises(ValueError, match=name):
                kind(**{**OTHERS.get(kind, {}), name: bad})
