"""The distances against brute force and linear programming."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linprog

from nvsdata import Events, metrics
from nvsdata.kernels.metrics.distances import least_work

# Table 3.3 of the thesis: inverted repeatability, Chamfer, EMD, score
TABLE_3_3 = np.array(
    [
        [0.575, 5.455, 2.448, 0.500],
        [0.496, 4.479, 2.597, 0.454],
        [0.469, 4.387, 2.467, 0.435],
        [0.464, 4.253, 2.434, 0.427],
        [0.455, 4.172, 2.307, 0.414],
    ]
)


@st.composite
def streams(draw, size=(40, 30), most=60):
    """Events, some of them many at a place, some crowded in a corner."""
    n = draw(st.integers(0, most))
    rng = np.random.default_rng(draw(st.integers(0, 2**32)))
    crowd = draw(st.sampled_from([1.0, 0.3, 0.05]))
    x, y = (np.floor(rng.random(n) * side * crowd).astype(int) for side in size)
    return Events(np.sort(rng.integers(0, 100_000, n)), x, y, rng.integers(0, 2, n), size, start=0)


def slow_frames(events, fps, duration):
    """Of each frame a dictionary from position to summed polarity, without zeros."""
    count = 1 if fps is None else max(math.ceil(duration * fps / 1_000_000), 1)
    frames = [{} for _ in range(count)]
    for t, x, y, p in zip(*(c.tolist() for c in events.columns), strict=True):
        frame = frames[0 if fps is None else max(math.ceil((t - events.start) * fps / 1_000_000) - 1, 0)]
        frame[x, y] = frame.get((x, y), 0) + 2 * p - 1
    return [{place: total for place, total in frame.items() if total} for frame in frames]


def slow_chamfer(a, b, weight):
    return np.mean(
        [
            min(math.dist((*place, weight * total), (*other, weight * value)) for other, value in b.items())
            for place, total in a.items()
        ]
    )


def slow_repeatability(a, b, epsilon):
    return np.mean(
        [
            any(math.dist(place, other) <= epsilon and value * total > 0 for other, value in b.items())
            for place, total in a.items()
        ]
    )


def slow_emd(a, b, blocks, size):
    side, result = math.isqrt(blocks), 0.0
    for row in range(side):
        for column in range(side):
            ours, theirs = (
                {p: abs(v) for p, v in f.items() if (p[0] * side // size[0], p[1] * side // size[1]) == (column, row)}
                for f in (a, b)
            )
            if ours and theirs:
                flow = min(sum(ours.values()), sum(theirs.values()))
                result += program(ours, theirs) / flow
    return result


def program(ours, theirs):
    """(3.15) as it is written, solved by scipy."""
    costs = np.array([[math.dist(p, q) for q in theirs] for p in ours])
    rows, columns = costs.shape
    limits = np.zeros((rows + columns, costs.size))
    for i in range(rows):
        limits[i, i * columns : (i + 1) * columns] = 1
    for j in range(columns):
        limits[rows + j, j::columns] = 1
    masses = [*ours.values(), *theirs.values()]
    flow = min(sum(ours.values()), sum(theirs.values()))
    return linprog(costs.ravel(), limits, masses, np.ones((1, costs.size)), [flow], method="highs").fun


@settings(max_examples=40)
@given(streams(), streams(), st.sampled_from([None, 30.0, 23.976]), st.sampled_from([1, 4, 16]))
def test_all_three_are_those_of_the_equations(a, b, fps, blocks):
    found = metrics.compare(a, b, fps, epsilon=2.5, blocks=blocks)
    duration = max(a.t.max(initial=0), b.t.max(initial=0))
    frames = list(zip(slow_frames(a, fps, duration), slow_frames(b, fps, duration), strict=True))
    used = [(ours, theirs) for ours, theirs in frames if ours and theirs]
    for distance, slow in (
        (found.chamfer, [slow_chamfer(*pair, math.sqrt(3)) for pair in used]),
        (found.repeatability, [slow_repeatability(*pair, 2.5) for pair in used]),
        (found.emd, [slow_emd(*pair, blocks, a.sensor_size) for pair in used]),
    ):
        assert len(distance.frames) == len(frames)
        assert distance.used == len(used)
        assert distance.empty_emulated == sum(not ours for ours, _ in frames)
        assert distance.empty_real == sum(not theirs for _, theirs in frames)
        np.testing.assert_allclose(distance.frames[~np.isnan(distance.frames)], slow, rtol=0, atol=1e-9)
        np.testing.assert_allclose(distance.value, np.mean(slow) if slow else math.nan, atol=1e-9)


@given(streams(most=200, size=(300, 200)), streams(most=40, size=(300, 200)), st.sampled_from([0.0, 1.0, 3.5, 40.0]))
def test_sparse_frames_are_searched_as_far_as_it_takes(a, b, epsilon):
    ours, theirs = slow_frames(a, None, 0)[0], slow_frames(b, None, 0)[0]
    if ours and theirs:
        assert float(metrics.chamfer(a, b)) == pytest.approx(slow_chamfer(ours, theirs, math.sqrt(3)), abs=1e-12)
        found = metrics.epsilon_repeatability(a, b, epsilon=epsilon)
        assert float(found) == pytest.approx(slow_repeatability(ours, theirs, epsilon), abs=1e-12)


@given(streams(), streams(), st.randoms())
def test_neither_order_nor_a_common_or_own_offset_matters(a, b, random):
    far = 1_600_000_000_000_000
    order = list(range(len(a)))
    random.shuffle(order)
    late = Events(a.t[order] + far, a.x[order], a.y[order], a.p[order], a.sensor_size, start=a.start + far)
    for value, moved in zip(metrics.compare(a, b).values, metrics.compare(late, b).values, strict=True):
        assert moved == pytest.approx(value, abs=1e-12, nan_ok=True)
    later = Events(b.t + far, b.x, b.y, b.p, b.sensor_size, start=b.start)
    assert metrics.compare(a, later, None).values[0] == pytest.approx(
        metrics.compare(a, b, None).values[0], nan_ok=True
    )


def test_an_offset_moves_the_real_stream():
    a = Events([50_000], [3], [3], [1], (8, 8), start=0)
    b = Events([10_000], [3], [3], [1], (8, 8), start=0)
    assert metrics.chamfer(a, b, fps=25).used == 0
    assert metrics.chamfer(a, b, fps=25, offset=40_000).value == 0


@pytest.mark.parametrize(
    ("ours", "theirs", "offset", "frames"),
    [
        (10_000, 10_000, 0, 1),
        (40_000, 10_000, 30_000, 1),
        (40_000, 10_000, 30_001, 2),
        (40_000, 80_000, 0, 2),
        (40_000, 80_001, 0, 3),
        (40_000, 80_000, -40_000, 1),
        (40_001, 80_000, -100_000, 2),
        (0, 5, -10, 1),
    ],
)
def test_frames_reach_to_the_end_of_the_longer_stream(ours, theirs, offset, frames):
    a, b = (Events([100, 100 + end], [3, 3], [3, 3], [1, 1], (8, 8)) for end in (ours, theirs))
    found = metrics.compare(a, b, 25, offset=offset)
    assert [one.frames.size for one in (found.chamfer, found.repeatability, found.emd)] == [frames] * 3


@pytest.mark.parametrize("epsilon", [0, 8, 9.9, 10, 16, 64, 65, 1e3, 1e9, 1e300])
def test_no_epsilon_is_so_large_that_signs_do_not_matter(epsilon):
    on, off = (Events([1], [1], [1], [p], (8, 8)) for p in (1, 0))
    far = Events([1], [7], [7], [1], (8, 8))
    assert float(metrics.epsilon_repeatability(on, off, epsilon=epsilon)) == 0
    assert float(metrics.epsilon_repeatability(on, on, epsilon=epsilon)) == 1
    assert float(metrics.epsilon_repeatability(on, far, epsilon=epsilon)) == (epsilon >= 6 * math.sqrt(2))


@given(st.integers(1, 60), st.integers(1, 60), st.integers(1, 4), st.integers(0, 2**32))
def test_transport_equals_the_linear_program(n, m, heaviest, seed):
    rng = np.random.default_rng(seed)
    sides = []
    for size in (n, m):
        places = rng.choice(12 * 9, size, replace=False)
        sides.append(
            {
                (int(p % 12), int(p // 12)): int(v)
                for p, v in zip(places, rng.integers(1, heaviest + 1, size), strict=True)
            }
        )
    arguments = [
        np.array(column, kind)
        for side in sides
        for column, kind in (
            ([p[0] for p in side], float),
            ([p[1] for p in side], float),
            (list(side.values()), np.int64),
        )
    ]
    assert least_work(*arguments) == pytest.approx(program(*sides), abs=1e-9)


def test_identical_streams_are_no_distance_apart():
    rng = np.random.default_rng(0)
    a = Events(
        np.sort(rng.integers(0, 10**6, 900)),
        rng.integers(0, 50, 900),
        rng.integers(0, 50, 900),
        rng.integers(0, 2, 900),
    )
    assert metrics.compare(a, a).values == (0, 0, 0)


def test_emd_of_two_piles():
    """Three units, one of them surplus: two go 5 and 1 pixels."""
    a = Events([1, 1, 1], [0, 0, 9], [0, 0, 0], [1, 1, 1], (40, 40))
    b = Events([1, 1], [3, 8], [4, 0], [1, 0], (40, 40))
    assert metrics.emd(a, b, blocks=1).value == pytest.approx((5 + 1) / 2)


def test_score_gives_the_last_column_of_table_3_3():
    np.testing.assert_allclose(metrics.score(TABLE_3_3[:, :3]), TABLE_3_3[:, 3], atol=6e-4)
    with_gap = np.vstack([TABLE_3_3[:, :3], [np.nan, 1, 1]])
    np.testing.assert_allclose(metrics.score(with_gap)[:5], TABLE_3_3[:, 3], atol=0.05)
    assert np.isnan(metrics.score(with_gap)[5])
    assert (metrics.score(np.zeros((2, 3))) == 0).all()


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"blocks": 15}, "square number"),
        ({"blocks": 0}, "square number of at least 1, not 0"),
        ({"blocks": -1}, "square number of at least 1, not -1"),
        ({"blocks": 2}, "square number"),
        ({"epsilon": -1}, "epsilon must not be negative"),
        ({"weight": math.nan}, "weight must not be negative"),
        ({"fps": 0}, "fps must be positive"),
    ],
)
def test_settings_out_of_range(options, says):
    a = Events([1], [1], [1], [1], (8, 8))
    with pytest.raises(ValueError, match=says):
        metrics.compare(a, a, **options)


def test_different_sensors():
    with pytest.raises(ValueError, match="different sensors"):
        metrics.compare(Events([1], [1], [1], [1], (8, 8)), Events([1], [1], [1], [1], (9, 8)))
    with pytest.raises(ValueError, match="settings, distances"):
        metrics.score([1, 2])


def test_counts_are_of_the_time_that_both_sides_cover():
    """With an offset, or if one side ends first, events that the other has no time for don't count."""

    def one(start, end, polarity):
        t = np.arange(start, end + 1, 100)
        return Events(t, [1] * t.size, [1] * t.size, [polarity] * t.size, (4, 4), start=start, end=end)

    short, long = one(5_000, 15_000, 1), one(0, 60_000, 0)
    for offset, both in ((0, 101), (-50_000, 101), (-55_000, 51), (4_000, 61), (20_000, 0)):
        found = metrics.compare(short, long, 30, offset=offset)
        assert (found.emulated_events, found.real_events) == ((0, both), (both, 0))
