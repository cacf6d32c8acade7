"""Random graphs, and whether two of them are the same."""

from dataclasses import fields, replace

import numpy as np
import torch

from nvsdata import Events
from nvsdata.transforms import RadiusGraph


def scattered(n=40, seed=0, radius=3.0, y=None):
    """The radius graph of `n` events at random pixels of 34x34."""
    random = np.random.default_rng(seed)
    x, y_, p = random.integers(0, 34, n), random.integers(0, 34, n), random.integers(0, 2, n)
    return replace(RadiusGraph(radius)(Events(np.arange(n) * 10, x, y_, p, (34, 34))), y=y)


def same(a, b):
    """Whether two graphs, or two batches, have equal fields of equal types; an AssertionError names the first other."""
    assert type(a) is type(b)
    for field in fields(a):
        mine, other = getattr(a, field.name), getattr(b, field.name)
        assert type(mine) is type(other), field.name
        if isinstance(mine, torch.Tensor):
            assert mine.dtype == other.dtype, field.name
            assert torch.equal(mine, other), field.name
        else:
            assert mine == other, field.name
    return True
