"""Settings so small or large that products and quotients of them leave their types: results stay those of the text."""

import math
from fractions import Fraction

import numpy as np
import pytest
import torch

from nvsdata import Events
from nvsdata import transforms as T
from nvsdata.data.frame_edges import duration_bounds, frame_edges

TINY, HUGE = 5e-324, 1e300
LAST = 2**62 - 1
RANDOM = np.random.default_rng(0)
EVENTS = Events(
    np.arange(60) // 2 * 1_000 + 7,
    RANDOM.integers(0, 4, 60),
    RANDOM.integers(0, 3, 60),
    RANDOM.integers(0, 2, 60),
    (4, 3),
)
# from one end of time to the other
WIDE = Events([-LAST, 0, 5, LAST], [0, 1, 2, 0], [0, 0, 0, 0], [1, 1, 0, 1], (3, 1))

pytestmark = pytest.mark.filterwarnings("error::RuntimeWarning")


def joined(ev, radius, alpha, beta, most):
    """The edges of eq. 4.2 in whole numbers and fractions: {(source, target)}."""
    alpha, beta, radius = (Fraction(float(value)) for value in (alpha, beta, radius))
    t, x, y = (column.tolist() for column in ev.columns[:3])
    found = set()
    for i in range(len(t)):
        near = []
        for j in range(len(t)):
            apart = alpha * ((x[i] - x[j]) ** 2 + (y[i] - y[j]) ** 2) + beta * (t[i] - t[j]) ** 2
            if i != j and apart <= radius * radius:
                near.append((apart, abs(t[i] - t[j]), j))
        found |= {(j, i) for _, _, j in sorted(near)[:most]}
    return found


def edges(graph):
    return set(map(tuple, graph.edge_index.T.tolist()))


@pytest.mark.parametrize("ev", [EVENTS, WIDE], ids=["near", "wide"])
@pytest.mark.parametrize("pseudo", ["abs", "signed", "signed-time"])
@pytest.mark.parametrize(
    ("radius", "alpha", "beta"),
    [
        (TINY, 1, 0),
        (1e-30, 1, 0),
        (1e-30, 0, 0),
        (3.0, 0, 0),
        (3.0, 0, 1e-6),
        (3.0, 1, 0),
        (1e-150, HUGE, 0),
        (3.0, HUGE, 0),
        (1e30, 1, 0),
        (1e150, 1, 1),
        (3.0, 1, HUGE),
        (3.0, HUGE, HUGE),
    ],
)
@pytest.mark.parametrize("most", [1, 10**30])
def test_graphs_of_any_radius_and_weights(ev, pseudo, radius, alpha, beta, most):
    graph = T.RadiusGraph(radius, alpha=alpha, beta=beta, max_degree=most, pseudo=pseudo)(ev)
    assert edges(graph) == joined(ev, radius, alpha, beta, most)
    assert ((graph.edge_attr >= 0) & (graph.edge_attr <= 1)).all()


def test_pseudo_coordinates_of_a_reach_beyond_float32():
    near, far = T.KNNGraph(40, reach=HUGE)(EVENTS), T.KNNGraph(40, reach=TINY)(EVENTS)
    assert (near.edge_attr == 0.5).all()
    apart = (near.pos[near.edge_index[0]] - near.pos[near.edge_index[1]]).sign()
    assert torch.equal(far.edge_attr, (apart + 1) / 2)


@pytest.mark.parametrize("k", [1, 2, 59, 60, 10**6])
@pytest.mark.parametrize(("alpha", "beta"), [(0, 0), (TINY, 0), (0, TINY), (HUGE, HUGE), (HUGE, 0), (1, 1e-300)])
@pytest.mark.parametrize("ev", [EVENTS, WIDE], ids=["near", "wide"])
def test_samples_of_any_weights_are_events_in_order(ev, k, alpha, beta):
    found = T.NonUniformSample(k, alpha=alpha, beta=beta)(ev)
    rows = set(zip(*(column.tolist() for column in ev.columns), strict=True))
    assert set(zip(*(column.tolist() for column in found.columns), strict=True)) <= rows
    assert math.ceil(len(ev) / k) <= len(found) <= len(ev)
    assert (np.diff(found.t) >= 0).all()


def faded(age, tau):
    """exp(-age / tau) for whole ages, without a quotient that overflows."""
    return math.exp(-float(min(Fraction(age) / Fraction(tau), 10_000)))


@pytest.mark.parametrize("tau", [TINY, 1e-300, 1e-5, 1 / 128, 0.7, 33.3, 1e6, 1e17, HUGE])
@pytest.mark.parametrize("ev", [EVENTS, WIDE], ids=["near", "wide"])
def test_surfaces_of_any_time_constant(ev, tau):
    """An epoch of 300 tau once was a float: beyond int64, and with late times, it gave NaN."""
    width, height = ev.sensor_size
    t, x, y, p = (column.tolist() for column in ev.columns)
    plain, around, latest = np.zeros((2, height, width)), np.zeros((len(t), 3, 3)), {}
    cells, count = np.zeros((2, 3, 3)), len(t)
    for i in range(count):
        latest[1 - p[i], y[i], x[i]] = t[i]
        for r in range(3):
            for c in range(3):
                place = 1 - p[i], y[i] + r - 1, x[i] + c - 1
                if place in latest:
                    around[i, r, c] = faded(t[i] - latest[place], tau)
                if 0 <= place[1] < height and 0 <= place[2] < width:
                    cells[1 - p[i], r, c] += sum(
                        faded(t[i] - t[j], tau)
                        for j in range(i)
                        if (1 - p[j], y[j], x[j]) == place and 0 < t[i] - t[j] <= 2**62
                    )
    for place, time in latest.items():
        plain[place] = faded(t[-1] - time, tau)
    np.testing.assert_allclose(T.TimeSurface(tau)(ev).numpy(), plain, rtol=1e-6, atol=1e-30)
    np.testing.assert_allclose(T.EventSurfaces(1, tau)(ev).numpy(), around, rtol=1e-6, atol=1e-30)
    found = T.HATS(10, 1, window=2**62, tau=tau)(ev)[0].numpy()
    np.testing.assert_allclose(found, cells / count, rtol=1e-6, atol=1e-30)


def test_windows_of_surfaces_and_frames_beyond_int64():
    for ev in (EVENTS, WIDE):
        assert T.HATS(10, 1, window=2**70)(ev).equal(T.HATS(10, 1, window=2**63 - 1)(ev))
        assert T.TimeSurface(every=2**70)(ev)[0].equal(T.TimeSurface()(ev))
        assert T.ToFrames(duration=2**70)(ev).equal(T.ToFrames(1)(ev))
    # more than 2^62, and still two frames
    assert duration_bounds(WIDE, 2**62 + 10).tolist() == [0, 3, 4]
    assert duration_bounds(Events([-LAST, 3, 8, 9], [0] * 4, [0] * 4, [0] * 4), 2**62 + 7).tolist() == [0, 2, 4]


@pytest.mark.parametrize("fps", [TINY, 1e-300, 1e-20, 1e-13])
@pytest.mark.parametrize("ev", [EVENTS, WIDE], ids=["near", "wide"])
def test_a_frame_rate_so_low_that_the_first_frame_holds_all(ev, fps):
    assert T.ToFrames(fps=fps, values="sum")(ev).equal(T.ToFrames(1, values="sum")(ev))
    assert (np.diff(frame_edges(ev.end - ev.start, fps)) > 0).all()


@pytest.mark.parametrize(("ev", "fps"), [(EVENTS, HUGE), (EVENTS, 1e12), (WIDE, HUGE), (WIDE, 1e-3)])
def test_a_frame_rate_that_gives_too_many_frames(ev, fps):
    with pytest.raises(ValueError, match="which are too many: check `Events"):
        T.ToFrames(fps=fps, values="sum")(ev)


@pytest.mark.parametrize("sigma", [1e17, 1e18, 1e19, 1e30, HUGE])
@pytest.mark.parametrize("ev", [EVENTS, WIDE], ids=["near", "wide"])
def test_jitter_of_any_size_stays_within_the_events_time(ev, sigma):
    """Moves beyond int64 once all led to the beginning."""
    torch.manual_seed(0)
    moves = torch.randn(len(ev)).numpy().astype(float) * sigma
    expected = sorted(min(max(t + round(move), ev.start), ev.end) for t, move in zip(ev.t.tolist(), moves, strict=True))
    torch.manual_seed(0)
    assert T.TimeJitter(sigma)(ev).t.tolist() == expected
    assert len(T.SpatialJitter(sigma)(ev)) == 0


def test_shares_of_the_longest_time():
    """Products of shares and times above 2^53 are rounded, maybe upwards."""
    assert len(T.DropByTime(1.0)(WIDE)) == 0
    long = Events([0, 2**62 - 2**54 + 1], [0, 0], [0, 0], [1, 1])
    latest = int(long.t[-1])
    for low in (0.0, 0.5, math.nextafter(1, 0)):
        for _ in range(20):
            window = T.RandomWindow(10, within=(low, 1.0))(long)
            assert 0 <= window.start <= latest - 9
    with pytest.raises(ValueError, match="µs if they count from their beginning"):
        T.RelativeTime()(WIDE)
    assert T.RelativeTime()(long.window(1)).t.tolist() == [latest - 1]


@pytest.mark.parametrize("leak", [0, TINY, 1e-9, 1.0, 1e300])
def test_leaks_of_any_size(leak):
    t, x, y, _ = (column.tolist() for column in EVENTS.columns)
    values, since = {}, {}
    for time, place in zip(t, zip(y, x, strict=True), strict=True):
        left = Fraction(values.get(place, 0)) - Fraction(leak) * (time - since.get(place, time))
        values[place], since[place] = max(left, Fraction(0)) + 1, time
    expected = np.zeros((3, 4))
    for place, value in values.items():
        expected[place] = float(max(value - Fraction(leak) * (t[-1] - since[place]), 0))
    with np.errstate(over="ignore"):
        np.testing.assert_allclose(T.LeakyFrame(leak)(EVENTS)[0].numpy(), expected, rtol=1e-6)


def test_rates_periods_and_bins_of_any_size():
    for ev in (EVENTS, WIDE):
        assert len(T.HotPixels(TINY)(ev)) == 0
        assert T.HotPixels(HUGE)(ev) == ev
        first = {place: i for i, place in reversed(list(enumerate(zip(ev.x.tolist(), ev.y.tolist(), strict=True))))}
        kept = T.RefractoryPeriod(2**70)(EVENTS)
        assert ev is WIDE or kept == EVENTS[np.array(sorted(first.values()))]
        assert T.TAF(2, 2**70)(ev).isfinite().all()
        assert T.TORE(2, shortest=0, longest=HUGE)(ev).isfinite().all()
        assert T.MixedDensityStack(60)(ev)[-1].equal(T.ToFrames(1, values="sum")(ev)[0])
        assert T.VoxelGrid(2**10)(ev).sum(0).sub(T.ToFrames(1, values="sum")(ev)[0]).abs().max() < 1e-5
