"""Loops over pixels' events: they touch what events there are, not the sensor; in the build that counts indices."""

import numpy as np
import pytest

from nvsdata.kernels import _native
from nvsdata.kernels.represent.patches import merged_pixels, patch_counts
from nvsdata.kernels.represent.sample import nonuniform_sample

FEW, MANY = 60, 2_000

pytestmark = pytest.mark.skipif(not _native.checks_bounds, reason="counts are those of the build with NVSDATA_BOUNDS=1")


def touched(function, *arguments):
    _native.touched()
    function(*arguments)
    return _native.touched()


def scattered(n, width):
    rng = np.random.default_rng(0)
    x, y = rng.integers(0, width, (2, n)).astype(np.int16)
    return np.arange(n), x, y, (x % 2).astype(np.uint8)


def patches(width):
    _, x, y, p = scattered(FEW, width)
    return touched(patch_counts, x, y, p, np.stack((x, y), 1).astype(np.float32)[:20], 5)


def test_patches_cost_as_much_as_their_pixels_however_large_the_sensor():
    small, large = patches(100), patches(800)
    # 20 patches of 25 pixels: a tile, a value, and two results for each; of an event x, y, p, its tile and its value
    assert max(small, large) <= 20 * (25 * 4 + 10) + FEW * 8
    assert large <= small


def test_twice_as_many_events_are_merged_at_about_twice_the_cost():
    once, twice = (touched(merged_pixels, *scattered(n, 30)) for n in (MANY, 2 * MANY))
    assert once <= MANY * 16
    assert twice <= 2.1 * once


def test_sampling_costs_as_much_as_its_splits():
    _native.touched()
    nonuniform_sample(*scattered(MANY, 100)[:3], 8, 1.0, 0.5e-5, 0)
    levels = np.ceil(np.log2(MANY / 8))
    # of an event in each split: its place is compared, and three columns are read and written twice
    assert _native.touched() <= MANY * (levels * 10 + 4)
