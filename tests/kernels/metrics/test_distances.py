"""Nearest spikes, and mass at the same place, against every pair compared."""

import numpy as np
import pytest

from nvsdata.kernels.metrics.distances import cancel, nearest_spikes, spikes, sum_polarity


def places(rng, shape, count, pattern):
    """Rows, columns and values of `count` spikes at different pixels, all over the frame or side by side."""
    height, width = shape
    if pattern == "clump":
        side = int(np.ceil(np.sqrt(count)))
        top, left = rng.choice((0, height - side)), rng.choice((0, width - side))
        y, x = np.divmod(np.arange(count), side)
        y, x = y + top, x + left
    else:
        y, x = np.divmod(rng.choice(height * width, count, replace=False), width)
    return x, y, rng.choice((-3, -2, -1, 1, 2, 5), count)


@pytest.mark.parametrize("shape", [(50, 70), (20, 97), (33, 16)])
@pytest.mark.parametrize(
    ("pattern", "share"), [("scattered", 0.1), ("scattered", 0.02), ("clump", 0.03), ("few", 0.001), ("few", 0.01)]
)
@pytest.mark.parametrize("limit", [np.inf, 5.0, 36.0, 37.0, 400.0])
def test_the_nearest_of_all_others_is_found(shape, pattern, share, limit):
    rng = np.random.default_rng(round(1_000 * share))
    b = places(rng, shape, max(int(share * shape[0] * shape[1]), 1), pattern)
    a = places(rng, shape, 25, "scattered")
    for weight in (0.0, 0.5, 4.0, 900.0):
        apart = [one[:, None] - other for one, other in zip(a, b, strict=True)]
        expected = (apart[0] ** 2 + apart[1] ** 2 + weight * apart[2] ** 2).min(1)
        found = nearest_spikes(*a, *b, shape, weight, limit)
        near = expected <= limit
        assert found[near].tolist() == expected[near].tolist()
        assert (found[~near] > limit).all()


def test_polarity_is_summed_and_gathered_in_raster_order():
    rng = np.random.default_rng(0)
    for n in (0, 1, 2, 40):
        x, y = rng.integers(0, 5, n).astype(np.int16), rng.integers(0, 3, n).astype(np.int16)
        p = rng.integers(0, 2, n).astype(np.uint8)
        sums, touched = np.zeros((3, 5), np.int64), np.empty(n, np.int64)
        expected = np.zeros((3, 5), int)
        np.add.at(expected, (y, x), 2 * p.astype(int) - 1)
        count = sum_polarity(x, y, p, sums, touched)
        assert sums.tolist() == expected.tolist()
        # those that came back to 0 may be there again
        assert set(touched[:count].tolist()) == set((y.astype(int) * 5 + x).tolist())
        found = spikes(sums, touched, count)
        rows, columns = np.nonzero(expected)
        assert [part.tolist() for part in found] == [columns.tolist(), rows.tolist(), expected[rows, columns].tolist()]
        assert not sums.any()


@pytest.mark.parametrize(
    ("a", "b"),
    [
        ({}, {3: 1}),
        ({3: 1}, {}),
        ({1: 5, 4: 2, 7: 3}, {1: 5, 4: 3, 7: 1}),
        ({1: 5, 2: 1, 9: 1}, {2: 2, 3: 4, 8: 1, 9: 4}),
        ({5: 1}, {1: 1, 2: 1, 5: 2, 6: 1}),
        ({1: 1, 2: 1, 5: 2, 6: 1}, {5: 1}),
        ({0: 1, 1: 2}, {2: 3, 3: 1}),
    ],
)
def test_mass_at_the_same_place_cancels(a, b):
    columns = [np.array(column, np.int64) for side in (a, b) for column in (list(side), list(side.values()))]
    left = cancel(*columns)
    assert left[0].tolist() == [mass - min(mass, b.get(place, 0)) for place, mass in a.items()]
    assert left[1].tolist() == [mass - min(mass, a.get(place, 0)) for place, mass in b.items()]
    assert columns[1].tolist() == list(a.values())
    assert columns[3].tolist() == list(b.values())
