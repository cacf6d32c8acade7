"""Spikes that distances compare, and mass that is moved: what lies nearby, and what differs."""

import numpy as np
import pytest

from nvsdata.kernels import _native
from nvsdata.kernels.metrics.distances import least_work, nearest_spikes

counted = pytest.mark.skipif(not _native.checks_bounds, reason="only a build that checks indexes counts them")

SHAPE = 60, 80
LARGE = 240, 320
CELLS = 15 * 20  # of the large frame
WEIGHT = 3.0
NEAREST = 21  # pixels that are always looked at


def spikes(n, shape, shift=0):
    """Spikes of one sign at different places, in raster order."""
    places = np.sort(np.random.default_rng(0).permutation(shape[0] * (shape[1] - shift))[:n])
    y, x = np.divmod(places, shape[1] - shift)
    return x + shift, y, np.ones(n, np.int64)


def looked_at(a, b, shape):
    """Elements that it touches to find the nearest of `b` to each of `a`."""
    _native.touched()
    nearest_spikes(*a, *b, shape, WEIGHT, np.inf)
    return _native.touched()


@counted
@pytest.mark.parametrize("n", [600, 1200])
def test_a_spike_with_one_at_its_place_looks_at_the_nearest_pixels_only(n):
    equal, beside = spikes(n, SHAPE), spikes(n, SHAPE, 1)
    # its place and value, that of the other, and the result
    once = looked_at(equal, equal, SHAPE)
    assert once <= n * (NEAREST + 12)
    # none look further but those without: the first column of spikes
    assert looked_at(equal, beside, SHAPE) <= 1.1 * once


@counted
def test_few_spikes_compare_themselves_with_those_of_their_cell():
    x, y, _ = few = spikes(60, LARGE)
    together = (np.equal.outer(x // 16, x // 16) & np.equal.outer(y // 16, y // 16)).sum()
    # cells are counted; each spike is put into its cell, in two passes
    assert looked_at(few, few, LARGE) <= 3 * CELLS + 20 * 60 + 8 * together


@counted
def test_few_spikes_far_away_are_compared_at_most_once():
    near = spikes(60, (40, 40))
    far = near[0] + 250, near[1] + 150, near[2]
    assert looked_at(near, far, LARGE) <= 60 * (2 * CELLS + 8 * 60 + 20)


@counted
@pytest.mark.parametrize("n", [30, 120])
@pytest.mark.parametrize("line", [False, True])
def test_points_that_moved_by_a_pixel_are_moved_once_each(n, line):
    rng = np.random.default_rng(1)
    x, y = (np.arange(n) * 5, np.zeros(n, int)) if line else rng.integers(0, 200, (2, n)) * 5
    _native.touched()
    work = least_work(*points(x, y), *points(x + 1, y))
    touched = _native.touched()
    assert work == n
    # each looks at all sinks for the best, finds which one that is, and then looks once more: four elements of each
    assert touched <= 9 * n * n + 100 * n


def points(x, y):
    return x.astype(float), y.astype(float), np.ones(x.size, np.int64)


@pytest.fixture
def given(monkeypatch):
    """How many sources and sinks the search for the least work is given, each time."""
    from nvsdata.metrics import measures

    sizes, least_work = [], measures.least_work

    def counting(*arguments):
        sizes.append((arguments[0].size, arguments[3].size))
        return least_work(*arguments)

    monkeypatch.setattr(measures, "least_work", counting)
    return sizes


def block(left, side=12, size=(64, 64)):
    from nvsdata import Events

    x, y = np.meshgrid(np.arange(left, left + side), np.arange(10, 10 + side))
    return Events(np.arange(side * side), x.ravel(), y.ravel(), np.ones(side * side, int), size, start=0)


def test_mass_at_its_place_is_not_moved(given):
    from nvsdata import metrics

    assert metrics.emd(block(10), block(10)).value == 0
    assert given == []


def test_of_a_block_that_moved_only_its_ends_are_moved(given):
    from nvsdata import metrics

    assert metrics.emd(block(10), block(11), blocks=1).value == 1
    assert given == [(12, 12)]


def test_blocks_that_are_empty_on_a_side_are_left_out(given):
    from nvsdata import metrics

    metrics.emd(block(0, 4), block(48, 4))
    assert given == []
