"""Spikes that distances compare, and mass that is moved: what lies nearby, and what differs.

Run as a script by the fixture `counts`, without compiled kernels, so that arrays can count what is read and written.
"""

import json
from collections import Counter

import numpy as np
import pytest
from counting_work import counted, flat, touches, uncompiled, watched

SHAPE = 60, 80
WEIGHT = 3.0
UNASKED = 20  # nearest pixels, which are always looked at
LARGE = 240, 320


def spikes(n, shape, shift=0):
    """Spikes of one sign at different places, in raster order."""
    places = np.sort(np.random.default_rng(0).permutation(shape[0] * (shape[1] - shift))[:n])
    y, x = np.divmod(places, shape[1] - shift)
    return x + shift, y, np.ones(n, np.int64)


def nearest(a, b, shape):
    """What it takes to find the nearest of `b` to each of `a`: looks at the map, and spikes of `b` in cells."""
    from nvsdata.kernels import distances

    tally = Counter()
    x = watched(b[0], "others", tally)
    with touches(distances) as found:
        distances.nearest(*a, x, *b[1:], shape, WEIGHT, np.inf)
    return flat(found) | {"others": tally["others", "read"]}


def moved(a, b):
    """What it takes to move the mass of points to others: pivots, and sinks that were scanned."""
    from nvsdata.kernels import earth_mover

    tally = Counter()
    kept = dict(vars(earth_mover))
    counted(earth_mover, "_pivot", tally)
    counted(earth_mover, "_best_sink", tally, lambda _x, _y, bx, *_: bx.size)
    work = earth_mover.least_work(*a, *b)
    vars(earth_mover).update(kept)
    return dict(tally) | {"work": work}


def points(x, y):
    return x.astype(float), y.astype(float), np.ones(x.size, np.int64)


def work():
    """All counts, by scenario."""
    dense, beside = spikes(600, SHAPE), spikes(600, SHAPE, 1)
    few = spikes(60, LARGE)
    near = spikes(60, (40, 40))
    far = near[0] + 250, near[1] + 150, near[2]
    rng = np.random.default_rng(1)
    x, y = rng.integers(0, 200, 40) * 5, rng.integers(0, 200, 40) * 5
    line = np.arange(30) * 5
    return {
        "equal": nearest(dense, dense, SHAPE),
        "beside": nearest(dense, beside, SHAPE),
        "few, equal": nearest(few, few, LARGE),
        "few, far": nearest(near, far, LARGE),
        "moved by a pixel": moved(points(x, y), points(x + 1, y)),
        "moved by a pixel along a line": moved(points(line, 0 * line), points(line + 1, 0 * line)),
    }


@pytest.fixture(scope="module")
def counts():
    return uncompiled(__file__)


def test_a_spike_with_one_at_its_place_looks_at_the_nearest_pixels_only(counts):
    # the map at home, the result so far; and of each of the twenty its offset and the map there
    assert counts["equal"]["distances read"] == 600 * (2 + 2 * UNASKED)
    assert counts["equal"]["others"] == 600


def test_a_spike_with_one_beside_it_looks_hardly_further(counts):
    # none but those without: the first column of spikes
    assert counts["beside"]["distances read"] <= 1.1 * counts["equal"]["distances read"]


def test_few_spikes_compare_themselves_with_those_of_their_cell(counts):
    x, y, _ = spikes(60, LARGE)
    together = (np.equal.outer(x // 16, x // 16) & np.equal.outer(y // 16, y // 16)).sum()
    # each is put into its cell, in two passes
    assert counts["few, equal"]["others"] <= 2 * 60 + together


def test_few_spikes_far_away_are_compared_at_most_once(counts):
    far = counts["few, far"]
    assert far["others"] <= 2 * 60 + 60 * 60
    cells = 15 * 20
    assert far["distances read"] <= 60 * (2 * cells + 60 + 4)


def test_points_that_moved_by_a_pixel_are_moved_once_each(counts):
    for name, n in (("moved by a pixel", 40), ("moved by a pixel along a line", 30)):
        assert counts[name]["work"] == n
        assert counts[name]["_pivot"] == n
        # each looks at all sinks for the best, and then once more to see that there is no better one
        assert counts[name]["_best_sink"] == 2 * n * n


@pytest.fixture
def given(monkeypatch):
    """How many sources and sinks the search for the least work is given, each time."""
    from nvsdata.metrics import distance

    sizes, least_work = [], distance.least_work

    def counting(*arguments):
        sizes.append((arguments[0].size, arguments[3].size))
        return least_work(*arguments)

    monkeypatch.setattr(distance, "least_work", counting)
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


if __name__ == "__main__":
    np.seterr(all="ignore")
    print(json.dumps(work()))
