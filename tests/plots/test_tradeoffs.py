import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from nvsdata.plots import pareto_front, tradeoff

POINTS = st.lists(st.tuples(st.integers(1, 9), st.integers(0, 9)), min_size=1, max_size=12)


@given(POINTS)
def test_the_front_is_what_nothing_surpasses(points):
    found = pareto_front(points)
    assert [points[i][0] for i in found] == sorted({points[i][0] for i in found})
    best = [max(gain for cost, gain in points if cost <= limit) for limit, _ in points]
    for (cost, _), gain in zip(points, best, strict=True):
        assert max(points[i][1] for i in found if points[i][0] <= cost) == gain
    for i in found:
        assert not any(c <= points[i][0] and g > points[i][1] for c, g in points)


def test_a_picture_has_the_points_in_it():
    points = [(1.0, 0.5), (2.0, 0.9), (3.0, 0.7)]
    picture = tradeoff(points, ["cheap", "good", "neither"], "title", "cost", "gain")
    assert picture.shape == (560, 900, 3)
    assert picture.dtype == np.uint8
    one = tradeoff(points[:1], ["cheap"], "title", "cost", "gain")
    assert (picture != one).any()
