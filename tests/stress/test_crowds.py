"""A million events of one pixel, pixels at the edges of the smallest and largest sensors: counts stay whole numbers."""

from fractions import Fraction

import numpy as np
import pytest
import torch

import nvsdata
from nvsdata import EventFolder, Events, collate, models
from nvsdata import transforms as T
from nvsdata.datasets.store.writer import pack
from nvsdata.kernels.graph.neighbors import near_edges

MANY = 1_000_000
SIDE = 32_767  # pixels of the largest sensor


def crowd(always_on):
    """Events of the middle one of three pixels, at rising times."""
    rng = np.random.default_rng(0)
    t = np.arange(MANY) * 10 if always_on else np.sort(rng.integers(0, 10**7, MANY))
    p = np.ones(MANY, np.uint8) if always_on else (rng.random(MANY) < 0.7).astype(np.uint8)
    return Events(t, np.ones(MANY, int), np.zeros(MANY, int), p, (3, 1))


CROWDS = [crowd(True), crowd(False)]


def error(found, exact):
    """The largest relative error; of zeros, the largest number found there."""
    found, exact = np.asarray(found, np.float64).ravel(), np.asarray(exact, np.float64).ravel()
    assert np.isfinite(found).all()
    assert found.shape == exact.shape
    return float((np.abs(found - exact) / np.where(exact == 0, 1, np.abs(exact))).max())


def middle(tensor):
    """What the crowded pixel has; all others have nothing."""
    assert not tensor[..., 0, [0, 2]].any()
    return tensor[..., 0, 1]


@pytest.mark.parametrize("ev", CROWDS, ids=["on", "mixed"])
def test_a_million_events_are_counted_exactly(ev):
    on = int(ev.p.sum())
    off = MANY - on
    assert middle(T.ToFrames(1)(ev)).tolist() == [[on, off]]
    assert middle(T.ToFrames(count=MANY)(ev)).tolist() == [[on, off]]
    assert middle(T.ToFrames(1, values="sum")(ev)).tolist() == [on - off]
    assert middle(T.StackedHistogram(1, 10**9)(ev)).tolist() == [off, on]
    assert middle(T.StackedHistogram(10, 10**9)(ev)).view(2, 10).sum(1).tolist() == [off, on]
    assert middle(T.MixedDensityStack(3)(ev))[2].item() == on - off
    assert middle(T.FourChannels()(ev))[:2].tolist() == [on, off]
    assert middle(T.ToFrames(fps=0.05, values="sum")(ev)).tolist() == [on - off]
    assert middle(T.BagOfEvents(MANY)(ev)).tolist() == [1]
    assert middle(T.EventImage()(ev)).double().sum().item() in (on - off, MANY)
    assert middle(T.GroupTokens(12, 1)(ev)).view(6, 2, 2)[:, :, 0].sum(0).tolist() == [off, on]
    rows = collate([(ev, 0)], events="columns")[0]
    assert int(rows.p.sum()) == on
    everything = T.MergePixels()(ev)
    assert everything.num_nodes == 1
    assert error(T.PatchMean(3)(ev, everything), [np.log1p(MANY), (on - off) / MANY]) < 1e-6


@pytest.mark.parametrize("ev", CROWDS, ids=["on", "mixed"])
def test_a_millions_sums_in_float32_stay_near_those_in_float64(ev):
    """Sums of shares are rounded at each event: at worst 2 in 10^5 and 1.4 in 10^4 are lost, by a million of events."""
    share, sign = (ev.t - ev.t[0]) / (ev.t[-1] - ev.t[0]), 2.0 * ev.p - 1
    bins = [(sign * np.maximum(0, 1 - np.abs(b - 4 * share))).sum() for b in range(5)]
    assert error(middle(T.VoxelGrid(5)(ev)), bins) < 4e-5
    part = (ev.t - ev.t[0]) * 6 // (ev.t[-1] - ev.t[0] + 1)
    times = [[share[(part == k) & (ev.p == p)].sum() for p in (0, 1)] for k in range(6)]
    assert error(middle(T.GroupTokens(12, 1)(ev)).view(6, 2, 2)[:, :, 1], times) < 3e-4
    third = slice(2 * (MANY // 3), 3 * (MANY // 3))
    off = share[third][ev.p[third] == 0]
    assert error(middle(T.ERGO12()(ev))[:2], [sign.var(), off.var() if off.size else 0]) < 1e-6


def test_what_a_network_makes_of_100_000_events_stays_near_float64():
    ev = CROWDS[1][::10]
    share = (ev.t - ev.t[0]) / (ev.t[-1] - ev.t[0])
    est = models.EST(3)
    with torch.no_grad():
        found = middle(est(collate([(ev, 0)], events="columns")[0])).view(2, 3)
        lines = est.double().kernel(torch.from_numpy(np.stack([share - c / 2 for c in range(3)]))).numpy()
    sums = np.array([[(share * line)[ev.p == p].sum() for line in lines] for p in (0, 1)])
    assert np.abs(found.numpy() - sums).max() < 1e-5 * np.abs(sums).max()


@pytest.mark.parametrize("ev", CROWDS, ids=["on", "mixed"])
def test_surfaces_of_a_million_events(ev):
    last = [ev.t[ev.p == p][-1] if (ev.p == p).any() else None for p in (1, 0)]
    shown = [0 if t is None else np.exp((t - ev.end) / 1e6) for t in last]
    assert error(middle(T.TimeSurface(1e6)(ev)), shown) < 1e-6
    # a later event elsewhere: the value was multiplied up from event to event
    later = Events([*ev.t, ev.end + 10**6], [*ev.x, 2], [*ev.y, 0], [*ev.p, 1], (3, 1))
    shown = [0 if t is None else np.exp((t - later.end) / 1e6) for t in last]
    assert error(T.TimeSurface(1e6)(later)[:, 0, 1], shown) < 1e-6
    latest = ev.t[ev.p == 1][:-4:-1]
    ages = np.maximum(np.log1p((ev.end - latest).astype(float)), np.log1p(150)) - np.log1p(150)
    assert error(T.TORE()(ev)[:3, 0, 1], ages) < 1e-6
    leaked, before = Fraction(0), int(ev.t[0])
    for t in ev.t[-3_000:].tolist():
        leaked, before = max(leaked - Fraction(1, 50) * (t - before), 0) + 1, t
    assert error(middle(T.LeakyFrame(0.02)(ev[-3_000:])), [float(leaked)]) < 1e-6
    # the mean, over events, of the sum of exponentials of those up to 1 ms before
    sums = []
    for p in (1, 0):
        t = ev.t[ev.p == p]
        begin, end, total = np.searchsorted(t, t - 1000), np.searchsorted(t, t), 0.0
        for back in range(1, int((end - begin).max(initial=0)) + 1):
            there = end - back >= begin
            total += np.exp((t[(end - back)[there]] - t[there]) / 500).sum()
        sums.append(total / MANY)
    assert error(T.HATS(10, 0, window=1000, tau=500)(ev)[0, :, 0, 0], sums) < 1e-6


@pytest.mark.parametrize("ev", CROWDS, ids=["on", "mixed"])
def test_filters_of_a_million_events(ev):
    kept, free = [], -(2**63)
    for i, t in enumerate(ev.t.tolist()):
        if t >= free:
            kept.append(i)
            free = t + 1_000
    assert T.RefractoryPeriod(1_000)(ev) == ev[np.array(kept)]
    assert len(T.BackgroundActivity(1_000)(ev)) == 0
    assert len(T.HotPixels(MANY / (ev.end - ev.start) * 1e6 * 0.999)(ev)) == 0
    assert len(T.HotPixels(MANY / (ev.end - ev.start) * 1e6 * 1.001)(ev)) == MANY
    assert error(T.DART()(ev[:100_000]).sum(1), np.ones(100_000)) < 1e-6


def test_a_graph_of_a_million_events_joins_those_next_in_time():
    graph = T.RadiusGraph(max_degree=2)(CROWDS[0])
    assert graph.num_edges == 2 * MANY
    source = graph.edge_index[0].view(-1, 2)
    index = torch.arange(1, MANY - 1)
    assert source[1:-1].sort(1).values.equal(torch.stack((index - 1, index + 1), 1))
    assert (graph.edge_attr == 0.5).all()


def test_a_store_and_files_hold_a_million_events_of_a_pixel(tmp_path):
    (tmp_path / "data/a").mkdir(parents=True)
    for number, ev in enumerate(CROWDS):
        nvsdata.write(ev, tmp_path / f"data/a/{number}.h5")
    pack(EventFolder(tmp_path / "data"), tmp_path / "a.h5")
    store = EventFolder(tmp_path / "a.h5")
    assert [store[number][0] for number in range(2)] == CROWDS


def test_a_million_nodes_are_pooled_into_one():
    """Means are summed in float64, as are positions; the nodes of a grid's cell in float32."""
    graph = T.RadiusGraph(max_degree=1)(CROWDS[1])
    value = torch.rand(MANY, 1) + 1
    graph = nvsdata.GraphBatch.from_graphs([graph])
    graph.x[:] = value
    exact = float(value.double().mean())
    pooled = models.GraphPool((3, 1), (3, 1), "average")(graph)
    assert error(pooled.x, [exact]) < 1e-7
    assert (pooled.pos.tolist(), pooled.t.tolist()) == ([[1, 0]], [sum(graph.t.tolist()) // MANY])
    assert models.GraphPool((3, 1), (3, 1))(graph).x.item() == value.max().item()
    assert error(models.Graph2Grid((3, 1), (3, 1))(graph), [exact * MANY]) < 3e-4


@pytest.mark.parametrize("size", [(1, 1), (1, SIDE), (SIDE, 1), (2, 1)])
def test_corners_of_sensors_of_any_shape(size):
    width, height = size
    places = sorted({(0, 0), (width - 1, 0), (0, height - 1), (width - 1, height - 1)})
    x, y = np.array(places).repeat(2, 0).T
    p = np.tile([0, 1], len(places))
    ev = Events(np.arange(x.size) * 100, x, y, p, size)
    at = [(int(p), int(y), int(x)) for x, y, p in zip(x, y, p, strict=True)]

    def found(tensor):
        """Where a tensor [2, H, W], ON first, isn't 0."""
        return sorted((1 - c, row, column) for c, row, column in tensor.nonzero().tolist())

    assert found(T.ToFrames(1)(ev)[0]) == sorted(at)
    assert found(T.TimeSurface()(ev)) == sorted(at)
    assert found(T.FourChannels()(ev)[:2]) == sorted(at)
    assert found(T.GroupTokens(2, 1)(ev).view(2, 2, height, width)[:, 0].flip(0)) == sorted(at)
    assert found(T.TORE(1)(ev) < np.float32(np.log1p(5e6) - np.log1p(150))) == sorted(at)
    on = ev[ev.p == 1]
    assert T.VoxelGrid(2)(on).sum(0).nonzero().tolist() == sorted([row, column] for p, row, column in at if p)
    for filtered in (T.RefractoryPeriod(1)(ev), T.HotPixels(1e9)(ev)):
        assert filtered == ev
    assert T.Downsample(10**9)(ev).x.max() == 0
    assert T.HATS(10, 1)(ev).isfinite().all()
    assert T.EventSurfaces(3)(ev)[:, 3, 3].eq(1).all()
    graph = T.RadiusGraph(3.0, max_degree=3)(ev)
    expected = near_edges(ev.t, x.astype(np.int32), y.astype(np.int32), 3.0, 1.0, 0.0, 3)
    assert graph.edge_index.shape[1] == expected.shape[1]
    assert ((graph.edge_attr >= 0) & (graph.edge_attr <= 1)).all()
    assert T.Patch(3)(ev, graph).isfinite().all()
