"""What happens exactly at a bound: of draws, rates, times, pixels and messages."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from nvsdata import Events
from nvsdata import transforms as T
from nvsdata.transforms import rng as draws

LATEST = 2**62  # µs, which no time reaches
EVENTS = Events([3, 5, 8], [0, 2, 6], [1, 4, 0], [1, 0, 1], (7, 5))


class Fixed:
    """In place of the tensor that a draw fills."""

    def uniform_(self, generator=None):
        pass


@pytest.fixture
def drawn(monkeypatch):
    """Makes draws from [0, 1) give one number."""

    def always(value):
        monkeypatch.setattr(draws._scratch, "real", Fixed())
        monkeypatch.setattr(draws._scratch, "real_value", np.array(value, np.float32))
        monkeypatch.setattr(torch, "rand", lambda *shape, generator=None: torch.full(shape, float(value)))

    return always


CHANCES = [
    (lambda p: T.RandomFlip(p=p), EVENTS),
    (T.RandomPolarityFlip, EVENTS),
    (T.RandomTimeFlip, EVENTS),
    (lambda p: T.RandomApply(T.MergePolarities(), p), EVENTS),
    (lambda p: T.RandomFlip(p=p), T.EventImage()(EVENTS)),
]


@pytest.mark.parametrize(("make", "sample"), CHANCES)
@pytest.mark.parametrize(("p", "value", "happens"), [(0, 0, False), (0.5, 0.5, False), (0.5, 0.4999, True)])
def test_a_chance_is_of_draws_below_it(make, sample, p, value, happens, drawn):
    drawn(value)
    after = make(p)(sample)
    assert (torch.equal(after, sample) if isinstance(after, torch.Tensor) else after == sample) != happens


@pytest.mark.parametrize(("share", "value", "left"), [(0, 0, 3), (0.5, 0.5, 3), (0.5, 0.4999, 0), (1, 0.9999, 0)])
def test_events_are_dropped_by_draws_below_the_share(share, value, left, drawn, monkeypatch):
    drawn(share)
    monkeypatch.setattr(torch, "rand", lambda *shape, generator=None: torch.full(shape, float(value)))
    assert len(T.DropEvents(1.0)(EVENTS)) == left


@pytest.mark.parametrize(("bound", "places"), [(8, [1, 3, 5, 7]), (1, [0] * 4), (10**15, None)])
def test_voters_are_spread_evenly(bound, places):
    found, before = [], torch.get_rng_state()
    for number in range(4):
        with draws.deterministic_rng(number, 4):
            found.append(draws.window_start(bound))
    assert found == (places or [bound * n // 8 for n in (1, 3, 5, 7)])
    assert torch.equal(before, torch.get_rng_state())
    with pytest.raises(KeyError), draws.deterministic_rng(0, 4):
        raise KeyError
    assert len({draws.window_start(10**15) for _ in range(3)}) == 3


def test_nothing_is_scratch_for_a_cascade_without_memory():
    for transform, draws_some in ((T.FilterCascade(), False), (T.FilterCascade(decay=1.5), True)):
        before = torch.get_rng_state()
        transform(EVENTS)
        assert torch.equal(before, torch.get_rng_state()) != draws_some


def at(times, places, **given):
    """Events at one row of pixels."""
    return Events(times, places, [0] * len(times), [1] * len(times), (4, 1), **given)


def test_a_pixel_at_the_rate_is_not_hot():
    ev = at([0, 1_000, 2_000], [1, 1, 2])
    assert len(T.HotPixels(1_000)(ev)) == 3
    assert T.HotPixels(999)(ev).x.tolist() == [2]
    # a single moment counts as 1 µs
    for rate, left in ((1_000_000, 1), (999_999, 0), (500_000, 0)):
        assert len(T.HotPixels(rate)(at([7], [1]))) == left


@pytest.mark.parametrize(("span", "last"), [(0, 0), (1, 1), (2, 1)])
def test_shares_of_the_shortest_times(span, last):
    ev = at([5, 5 + span], [0, 1])
    assert T.FourChannels()(ev)[2].tolist() == [[0, last, 0, 0]]
    assert T.Points(2)(ev)[:, 2].tolist() == [0, last]
    assert T.Age()(ev, T.RadiusGraph()(ev)).tolist() == [[0], [last]]
    assert T.MergePixels(("mean",))(ev).x[:, 2].tolist() == [0, last]
    bins = [[1, 0, 0, 0], [0, 1, 0, 0]] if span else [[1, 1, 0, 0], [0] * 4]
    assert T.VoxelGrid(2)(ev).flatten(1).tolist() == bins


@pytest.mark.parametrize(("width", "last"), [(1, 0), (2, 1), (3, 1)])
def test_points_of_the_smallest_sensors(width, last):
    ev = Events([1, 2], [width - 1, 0], [0, width - 1], [0, 1], (width, width))
    assert T.Points(2)(ev)[:, :2].tolist() == [[last, 0], [0, last]]


@pytest.mark.parametrize("factor", [2, 16_384, 32_766, 32_767, 32_768, 10**9])
def test_downsampled_pixels_of_the_widest_sensor(factor):
    places = [0, 16_383, 16_384, 32_764, 32_765, 32_766]
    ev = Events(range(6), places, places[::-1], [0] * 6, (32_767, 32_767))
    found = T.Downsample(factor)(ev)
    assert found.x.tolist() == [place // factor for place in places]
    assert found.y.tolist() == found.x.tolist()[::-1]


def test_nodes_as_far_apart_as_events_can_be():
    graph = T.RadiusGraph()(at([1, 2], [0, 1]))
    for apart in (32_767, 32_768):
        nodes = replace(graph, pos=torch.tensor([[-5.0, 0.0], [apart - 5.0, 0.0]]))
        if apart == 32_767:
            assert T.KNNGraph()(nodes).edge_index.tolist() == [[1, 0], [0, 1]]
        else:
            with pytest.raises(ValueError, match="at most 32767 pixels apart along an axis"):
                T.KNNGraph()(nodes)


def test_without_distance_in_space_the_sensor_bounds_pseudo_coordinates():
    graph = T.RadiusGraph(alpha=0, pseudo="abs")(at([1, 2], [0, 3]))
    assert graph.reach == (4, 1)
    assert graph.edge_attr.tolist() == [[0.75, 0], [0.75, 0]]
    assert T.RadiusGraph(alpha=0, pseudo="abs")(replace(graph, sensor_size=None)).reach == (1, 1)
    assert T.RadiusGraph(3, alpha=0.25, pseudo="abs")(graph).reach == (6, 6)


@pytest.mark.parametrize(
    ("start", "end", "origin", "factor", "fits"),
    [
        (0, 2**61, 0, 2.0, False),
        (0, 2**61 - 2**10, 0, 2.0, True),
        (-(2**61), 0, 0, 2.0, False),
        (2**60, 2**61, 2**60, 3.0, False),
        (2**60, 2**61, 2**60, 2.5, True),
        (-(2**61), -(2**60), -(2**60), 3.0, False),
        (0, 2**60, -(2**60), 1.5, False),
    ],
)
def test_scaled_times_stay_below_the_latest(start, end, origin, factor, fits):
    ev = Events([start, end], [0, 0], [0, 0], [0, 0])
    # of a list, times count from the beginning of the first
    parts = [Events([origin], [0], [0], [0]), ev]
    if fits:
        expected = [origin + round((t - origin) * factor) for t in (start, end)]
        assert T.RandomTimeScale(factor, factor)(parts)[1].t.tolist() == expected
        assert max(map(abs, expected)) < LATEST
    else:
        with pytest.raises(ValueError, match=f"µs after scaling by {factor}"):
            T.RandomTimeScale(factor, factor)(parts)


def test_a_dropped_interval_begins_anywhere_and_ends_in_time():
    ev = at([10, 11, 12, 13], [0, 1, 2, 3])
    assert {tuple(T.DropByTime(0.5)(ev).t.tolist()) for _ in range(100)} == {(12, 13), (10, 13), (10, 11)}


def test_pixels_jitter_to_the_edges_and_not_beyond():
    n = 500
    ev = Events(range(n), [1] * n, [1] * n, [0] * n, (3, 4))
    torch.manual_seed(0)
    found = T.SpatialJitter(3.0)(ev)
    assert (set(found.x.tolist()), set(found.y.tolist())) == ({0, 1, 2}, {0, 1, 2, 3})


def test_a_square_has_at_least_a_pixel():
    torch.manual_seed(0)
    image = torch.arange(6.0).view(1, 2, 3)
    found = {float(T.RandomCrop(1, (0.1,))(image)) for _ in range(100)}
    assert found == set(range(6))


@pytest.mark.parametrize("scale", [1e-12, 1, 1e12])
def test_activity_is_compared_whatever_its_size(scale):
    frames = torch.zeros(2, 3, 9)
    frames[0, 1, 1], frames[1, 1, 7] = 0.9 * scale, scale
    assert T.MotionCrop(3)(frames)[1, 1].equal(frames[1, 1, 5:8])
    assert not T.MotionCrop(2)(torch.zeros(1, 4, 4)).any()


@pytest.mark.parametrize("transform", [T.TimeSurface(), T.TORE(), T.LeakyFrame(), T.TAF()], ids=repr)
def test_a_state_takes_what_happens_at_its_own_moment(transform):
    ev = at([10, 20], [0, 1])
    state = transform.state((4, 1))
    state.update(ev)
    assert state.tensor(20).equal(state.tensor())
    state.update(at([20], [3]))
    assert state.tensor().equal(transform(at([10, 20, 20], [0, 1, 3])))
    for size in ((5, 1), (4, 2)):
        with pytest.raises(ValueError, match="events of {}x{} pixels, but the state has 4x1".format(*size)):
            state.update(Events([30], [0], [0], [1], size))
    # a smaller sensor fits
    state.update(Events([30], [0], [0], [1], (3, 1)))
    assert state.tensor().equal(transform(at([10, 20, 20, 30], [0, 1, 3, 0])))


@pytest.mark.parametrize("text", ["Window(1, 2) + " + "3" * 300, "'" + "a" * 300])
def test_a_long_text_is_cut_in_the_message(text):
    with pytest.raises(ValueError, match="not the repr of a transform") as caught:
        T.from_repr(text)
    assert repr(text[:200]) in str(caught.value)
    assert text[:201] not in str(caught.value)
