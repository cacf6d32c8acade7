"""Whole numbers as settings: fractions are refused, and floats that are whole work like ints."""

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
    (T.Stacks, {"length": 3}, FRAMES),
    (T.SumFrames, {"factor": 3}, EVENTS),
    (T.ToFrames, {"bins": 4}, EVENTS),
    (T.ToFrames, {"count": 40}, EVENTS),
    (T.ToFrames, {"duration": 40_000}, EVENTS),
    (T.UniformNoise, {"count": 50}, EVENTS),
    (T.Volumes, {"count": 3, "duration": 9_000}, EVENTS),
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
