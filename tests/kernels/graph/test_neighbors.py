import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from strategies import events

from nvsdata import Events
from nvsdata.kernels.graph.neighbors import near_edges
from nvsdata.transforms import KNNGraph, RadiusGraph
from nvsdata.transforms.events.sampling import BETA, LITERAL_BETA

PIXELS, SWEEP = 0, 10**12  # `sweep_below` that forces one of the two ways


def slow_edges(t, x, y, radius, alpha, beta, k):
    """Every event compared with every other (eq. 4.2), in float64; equals by time in µs, then index."""
    places = [np.asarray(column, np.int64) for column in (x, y, t)]
    index, found = np.arange(len(t)), []
    for i in range(len(t)):
        apart = [column - column[i] for column in places]
        dx, dy, dt = (column.astype(np.float64) for column in apart)
        d = alpha * (dx * dx + dy * dy) + beta * (dt * dt)
        nearest = np.lexsort((index, np.abs(apart[-1]), d))
        near = nearest[(nearest != i) & (d[nearest] <= radius * radius)]
        found += [(j, i) for j in sorted(near[:k].tolist())]
    return found


def listed(edges):
    assert edges.dtype == np.int64
    return list(zip(*edges.tolist(), strict=True))


def assert_both_ways(t, x, y, *metric):
    expected = slow_edges(t, x, y, *metric)
    for way in (PIXELS, SWEEP):
        assert listed(near_edges(t, x, y, *metric, way)) == expected


@st.composite
def points(draw, max_size=60):
    """Times, x and y, many of them equal: all at one pixel, at one time, far apart in either, or late."""
    n = draw(st.integers(0, max_size))
    random = np.random.default_rng(draw(st.integers(0, 2**32)))
    gap = draw(st.sampled_from((0, 1, 20, 2_000, 10**6, 10**9)))
    t = np.cumsum(random.integers(0, gap + 1, n))
    t += draw(st.sampled_from((0, -(10**15), 2**62 - 1 - 60 * 10**9, -(2**62) + 1)))
    x, y = (
        (random.integers(0, draw(st.sampled_from((1, 3, 12, 34, 300))), n) * step + far).astype(np.int16)
        for step, far in ((draw(st.sampled_from((1, 1, 30))), draw(st.sampled_from((0, 2_000)))) for _ in range(2))
    )
    return t, x, y


metrics = st.tuples(
    st.sampled_from((0.5, 1.0, 2.9, 3.0, 7.5, 40.0, 30_000.0, math.inf)),
    st.sampled_from((1.0, 1.0, 0.3, 4.0, 1e-12, 1e-300, 0.0)),
    st.sampled_from((0.0, BETA, LITERAL_BETA, 1e-3, 1.0, 1e12)),
    st.sampled_from((1, 2, 3, 8, 32, 1_000)),
).filter(lambda given: given[0] < math.inf or given[1] > 0)


@settings(max_examples=400)
@given(place=points(), metric=metrics)
def test_edges_are_those_of_brute_force(place, metric):
    assert_both_ways(*place, *metric)


# all distances are sums of whole numbers, many of them exactly the radius's
whole = st.tuples(st.sampled_from((1.0, 2.0, 5.0)), st.just(1.0), st.sampled_from((0.0, 1.0, 4.0)), st.integers(1, 9))


@settings(max_examples=200)
@given(n=st.integers(2, 80), seed=st.integers(0, 2**32), side=st.integers(1, 6), metric=whole)
def test_equals_are_told_apart_by_time_and_order(n, seed, side, metric):
    random = np.random.default_rng(seed)
    t = np.sort(random.integers(0, 6, n))
    x, y = random.integers(0, side, (2, n)).astype(np.int16)
    assert_both_ways(t, x, y, *metric)


# weights, and times whose squares they make whole numbers, but for rounding
steps = st.sampled_from(((BETA, 200_000), (LITERAL_BETA, 1_000), (1e-3, 10), (0.1, 1), (0.3, 1), (1.7e-3, 10)))


@settings(max_examples=600)
@given(
    seed=st.integers(0, 2**32),
    n=st.integers(2, 24),
    step=steps,
    alpha=st.sampled_from((1.0, 1.0, 0.1, 0.3, 1.7, 1 / 3)),
    apart=st.tuples(st.integers(0, 20), st.sampled_from((0, 1, 4))),
    k=st.sampled_from((1, 3, 32)),
)
def test_a_bit_decides_at_exactly_the_radius(seed, n, step, alpha, apart, k):
    random = np.random.default_rng(seed)
    beta, gap = step
    t = np.cumsum(random.integers(0, 3, n)) * gap
    x, y = random.integers(0, random.choice([1, 2, 4, 8]), (2, n)).astype(np.int16)
    metric = math.sqrt(alpha * apart[0] + beta * gap**2 * apart[1]), alpha, beta, k
    assert_both_ways(t, x, y, *metric)


ROUNDED = {
    # 4 (0.5e-5)² 200,000² is a bit more than 2²
    "time a bit more than the radius": ((0, 400_000), (1, 1), (1, 1), (2.0, 1.0, BETA, 3)),
    "space a bit less than the radius": ((0, 0), (0, 3), (0, 2), (4.701063709417263, 1.7, 0.0, 1)),
    # distances of exactly 3 in space, and times too small to change them, at two pixels or with a late third
    "a time that adds nothing": ((0, 10**6), (0, 3), (0, 0), (3.0, 1.0, 1e-29, 1)),
    "a time that adds too much": ((0, 10**6), (0, 3), (0, 0), (3.0, 1.0, 1e-27, 1)),
    "one of several that adds nothing": ((0, 10**6, 10**15), (0, 3, 9), (0, 0, 0), (3.0, 1.0, 1e-29, 1)),
    "a long time a bit too long": (
        (0, 1881437544779541224),
        (1, 1),
        (1, 1),
        (0.12738500170148095, 1.0, 4.5841305985456874e-39, 1),
    ),
    "a long time, just near enough": (
        (0, 702257809059030935),
        (1, 1),
        (1, 1),
        (4.6349788948065145, 1.0, 4.356145401693061e-35, 1),
    ),
    # 4 plus a bit less than 1 is 5, like the pixel at 5, which is nearer in time
    "a time that makes up for space": ((0, 0, 1), (0, 2, 2), (0, 1, 0), (3.0, 1.0, np.nextafter(1.0, 0), 1)),
}


@pytest.mark.parametrize("way", [PIXELS, SWEEP], ids=["pixels", "sweep"])
@pytest.mark.parametrize("name", ROUNDED)
def test_bounds_are_rounded_like_distances(way, name):
    t, x, y, metric = ROUNDED[name]
    place = np.array(t), np.array(x, np.int16), np.array(y, np.int16)
    assert listed(near_edges(*place, *metric, way)) == slow_edges(*place, *metric)


@pytest.mark.parametrize(("n", "k"), [(4_000, 1), (9_000, 8), (4_000, 32)])
@pytest.mark.parametrize("beta", [BETA, 1e-9, LITERAL_BETA])
def test_both_ways_agree_on_busy_scenes(n, beta, k):
    random = np.random.default_rng(k)
    t = np.sort(random.integers(0, 30_000, n)) + 1_600_000_000_000_000
    x, y = (np.concatenate([random.integers(0, side, n // 2), random.integers(0, 20, n // 2)]) for side in (240, 180))
    metric = x.astype(np.int16), y.astype(np.int16), 3.0, 1.0, beta, k
    pixels, sweep, either = (near_edges(t, *metric, *way) for way in ((PIXELS,), (SWEEP,), ()))
    assert np.array_equal(pixels, sweep)
    assert np.array_equal(pixels, either)


@pytest.mark.parametrize("columns", [1, 2, 3, 5])
@pytest.mark.parametrize("k", [1, 8, 100, 150, 299])
def test_crowds_at_few_pixels(columns, k):
    random = np.random.default_rng(k)
    t = np.sort(random.integers(0, 3_000, 300))
    x, y = random.integers(0, columns, 300).astype(np.int16), np.zeros(300, np.int16)
    for metric in ((math.inf, 1.0, 0.0, k), (3.0, 1.0, BETA, k), (3.0, 1.0, LITERAL_BETA, k)):
        assert_both_ways(t, x, y, *metric)


def test_corners_of_the_largest_sensor():
    x = np.array([0, 32_767, 0, 32_767, 0, 32_766], np.int16)
    y = np.array([0, 0, 32_767, 32_767, 3, 32_767], np.int16)
    t = np.arange(6)
    for metric in ((3.0, 1.0, BETA, 32), (math.inf, 1.0, 0.0, 2)):
        for way in (PIXELS, SWEEP):
            assert listed(near_edges(t, x, y, *metric, way)) == slow_edges(t, x, y, *metric)
    # all on one side
    for metric in ((32_767.0, 1.0, BETA, 9), (32_767.0, 1.0, 0.0, 3), (32_766.0, 1.0, 0.0, 9)):
        for way in (PIXELS, SWEEP):
            assert listed(near_edges(t, x, t.astype(np.int16), *metric, way)) == slow_edges(t, x, t, *metric)


def test_times_at_both_ends_of_their_range():
    t = np.array([1 - 2**62, 2 - 2**62, 0, 2**62 - 2, 2**62 - 1])
    x = np.array([5, 5, 6, 5, 5], np.int16)
    for metric in ((3.0, 1.0, 0.0, 2), (3.0, 1.0, BETA, 2), (3.0, 1.0, 1e-40, 2), (math.inf, 1.0, 1.0, 3)):
        for way in (PIXELS, SWEEP):
            assert listed(near_edges(t, x, x, *metric, way)) == slow_edges(t, x, x, *metric)


def edges(graph):
    return set(zip(*graph.edge_index.tolist(), strict=True))


@given(events(max_size=60), st.sampled_from((0, -(10**15), 1_600_000_000_000_000, 2**62 - 200_000)))
def test_a_time_offset_changes_nothing(ev, offset):
    moved = Events(ev.t + offset, ev.x, ev.y, ev.p, ev.sensor_size)
    assert np.array_equal(RadiusGraph()(ev).edge_index, RadiusGraph()(moved).edge_index)
    assert np.array_equal(RadiusGraph()(ev).edge_attr, RadiusGraph()(moved).edge_attr)


@given(events(max_size=60, gap=400), st.randoms(use_true_random=False))
def test_the_order_of_events_changes_nothing(ev, random):
    # a cap that cuts between simultaneous sources at one distance goes by order, so none here
    order = list(range(len(ev)))
    random.shuffle(order)
    shuffled = Events(ev.t[order], ev.x[order], ev.y[order], ev.p[order], ev.sensor_size)

    def named(events):
        graph = RadiusGraph(max_degree=60)(events)
        names = list(zip(*(c.tolist() for c in events.columns), strict=True))
        return sorted((names[a], names[b]) for a, b in edges(graph))

    assert named(shuffled) == named(ev)


@given(events(max_size=120, gap=200))
def test_edges_are_grouped_by_target_and_sorted(ev):
    source, target = RadiusGraph(max_degree=4)(ev).edge_index.numpy()
    keys = target * (len(ev) + 1) + source
    assert (np.diff(keys) > 0).all()


def test_a_crowd_at_one_pixel_keeps_the_nearest():
    n = 50_000
    ev = Events(np.arange(n), np.full(n, 5), np.full(n, 5), np.zeros(n, int), (10, 10))
    for graph in (RadiusGraph(max_degree=32)(ev), RadiusGraph(beta=LITERAL_BETA)(ev), KNNGraph(32)(ev)):
        source, target = graph.edge_index.numpy()
        # 16 before and 16 after, or the first and the last 32 at the ends
        assert np.bincount(target).tolist() == [32] * n
        first = np.clip(np.arange(n) - 16, 0, n - 33)
        expected = first[:, None] + np.arange(33)
        assert np.array_equal(source, expected[expected != np.arange(n)[:, None]])


def test_a_crowd_at_one_pixel_and_time_keeps_the_first():
    n = 50_000
    ev = Events(np.zeros(n, int), np.full(n, 5), np.full(n, 5), np.zeros(n, int), (10, 10))
    for graph in (RadiusGraph(max_degree=32)(ev), RadiusGraph(beta=LITERAL_BETA)(ev), KNNGraph(32)(ev)):
        source, target = graph.edge_index.numpy()
        assert np.bincount(target).tolist() == [32] * n
        assert source[: 32 * 33].reshape(33, 32).tolist() == [[j for j in range(33) if j != i] for i in range(33)]
        assert (source[32 * 33 :].reshape(-1, 32) == np.arange(32)).all()


@pytest.mark.parametrize("beta", [BETA, LITERAL_BETA])
def test_dense_scenes_agree_with_a_tree(beta):
    from scipy.spatial import cKDTree

    rng = np.random.default_rng(1)
    n = 20_000
    ev = Events(np.sort(rng.integers(0, 30_000, n)), rng.integers(0, 240, n), rng.integers(0, 180, n), np.zeros(n, int))
    points = np.stack([ev.x, ev.y, ev.t * np.sqrt(beta)], 1)
    pairs = cKDTree(points).query_pairs(3.0)
    both = {*pairs, *((b, a) for a, b in pairs)}
    assert edges(RadiusGraph(beta=beta, max_degree=500)(ev)) == both


# corners of the nodes: some nodes are negative along an axis, or beyond 16 bits, others are not
narrow = (-3, 300), (300, -3), (-3, -3), (32_000, 32_762)
corners = [(np.int16, far) for far in narrow]
corners += [(np.int32, far) for far in (*narrow, (-3, 65_533), (65_533, 70_000), (2**31 - 9, -(2**31)))]


@pytest.mark.parametrize(("kind", "far"), corners)
@settings(max_examples=20)
@given(seed=st.integers(0, 2**32), metric=whole)
def test_coordinates_may_be_negative_or_beyond_16_bits(kind, far, seed, metric):
    random = np.random.default_rng(seed)
    t = np.sort(random.integers(0, 6, 40))
    x, y = (random.integers(0, 6, (2, 40)) + np.array(far)[:, None]).astype(kind)
    assert_both_ways(t, x, y, *metric)


def test_coordinates_too_far_apart_are_refused():
    t, x = np.arange(3), np.array([0, -5, 2**19], np.int32)
    for pair in ((x, t.astype(np.int32)), (t.astype(np.int32), x)):
        with pytest.raises(ValueError, match="524,288"):
            near_edges(t, *pair, 3.0, 1.0, 0.0, 8)
