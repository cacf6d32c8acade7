"""Networks that follow events against the same network on the whole window, and neighbors against their definition."""

from itertools import pairwise

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from nvsdata import Events, models
from nvsdata import transforms as T
from nvsdata.data.events import LATEST
from nvsdata.models.graph_cnn import input_of
from nvsdata.models.incremental import streaming
from nvsdata.transforms.events.sampling import LITERAL_BETA

SIZE = (34, 34)
SMALL = {"channels": (4, 6, 6, 5), "clusters": ((2, 2), (2, 2), (4, 4), (7, 7)), "hidden": 9}


def trained(seed=0, kind=models.RGCNN, **settings):
    """A network with statistics and weights of all kinds, as after training."""
    torch.manual_seed(seed)
    network = kind(3, **SMALL | settings)
    for part in network.modules():
        if getattr(part, "running_mean", None) is not None:
            part.running_mean.normal_(0, 0.2)
            part.running_var.uniform_(0.3, 2)
            torch.nn.init.uniform_(part.weight, -1, 1)
            torch.nn.init.normal_(part.bias, 0, 0.3)
    return network.eval()


def of_window(events, window):
    """The events that a stream of these has in its window."""
    until = -LATEST if window is None or not len(events) else int(events.t[-1]) - window + 1
    return events.window(until, None)


def whole(network, graph, events):
    with torch.no_grad():
        return network(graph(events))[0]


def drawn(rng, count, kind, start=0):
    """Events of all kinds: far apart, at the same places, at the same times."""
    wide, gap = {"wide": (34, 300), "narrow": (4, 100), "burst": (2, 0), "slow": (34, 9_000), "ties": (6, 2)}[kind]
    t = start + np.cumsum(rng.integers(0, gap + 1, count) * (rng.random(count) < 0.7))
    x, y = rng.integers(0, wide, (2, count)) + int(rng.integers(0, 35 - wide))
    return Events(t, x, y, rng.integers(0, 2, count), SIZE)


def joined(pieces):
    columns = [np.concatenate(column) for column in zip(*(piece.columns for piece in pieces), strict=True)]
    return Events(*columns, SIZE)


@pytest.fixture
def always(monkeypatch):
    """Rows are kept from the first step on, however many change."""
    monkeypatch.setattr(streaming, "MANY", 0)
    monkeypatch.setattr(streaming, "CALM", 1)


GRAPHS = [
    T.RadiusGraph(max_degree=6),
    T.RadiusGraph(max_degree=3, pseudo="abs"),
    T.RadiusGraph(max_degree=5, beta=LITERAL_BETA, pseudo="signed-time", reach_t=2_000),
    T.RadiusGraph(radius=5, alpha=2.0, beta=1e-4, max_degree=100),
]


@pytest.mark.parametrize("graph", GRAPHS, ids=str)
@settings(max_examples=12, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), window=st.sampled_from([None, 1, 700, 5_000]))
def test_scores_are_those_of_the_window_however_it_is_cut(always, graph, seed, window):
    rng = np.random.default_rng(seed)
    dim = 3 if graph.pseudo == "signed-time" else 2
    network = trained(
        seed % 7, models.RGCNN if seed % 2 else models.GCNN, dim=dim, pooling=("max", "average")[seed % 3 == 0]
    )
    live = models.stream(network, window, graph)
    pieces, now = [], int(rng.integers(-(10**6), 10**15))
    for _ in range(14):
        kind = ("wide", "narrow", "burst", "slow", "ties")[rng.integers(5)]
        pieces.append(drawn(rng, int(rng.integers(0, 40)), kind, now))
        now = int(pieces[-1].t[-1]) if len(pieces[-1]) else now + int(rng.integers(0, 3_000))
        live.feed(pieces[-1])
        if rng.random() < 0.7:
            given_events = of_window(joined(pieces), window)
            assert len(live) == len(given_events)
            torch.testing.assert_close(live.scores(), whole(network, graph, given_events), atol=1e-5, rtol=0)
    assert live._live is not None


@pytest.mark.parametrize(
    "network",
    [
        {"loops": False},
        {"root_weight": False},
        {"kernel_size": 1},
        {"kernel_size": 3},
        {"clusters": ((3, 2), (5, 4), (5, 4), (11, 9)), "sensor_size": (40, 36)},
        {"clusters": ((34, 34), (34, 34), (34, 34), (34, 34))},
    ],
    ids=str,
)
def test_networks_of_all_shapes_can_stream(always, network):
    rng = np.random.default_rng(3)
    network, graph = trained(1, **network), GRAPHS[0]
    live = models.stream(network, 4_000, graph)
    events = joined([drawn(rng, 300, "wide"), drawn(rng, 200, "narrow", 50_000)])
    for at in range(0, 500, 7):
        live.feed(events[at : at + 7])
        found = live.scores()
    torch.testing.assert_close(found, whole(network, graph, of_window(events, 4_000)), atol=1e-5, rtol=0)


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), k=st.integers(1, 9), window=st.sampled_from([60, 900, 10**9]))
def test_neighbors_are_those_of_the_graph(always, seed, k, window):
    rng = np.random.default_rng(seed)
    beta, pseudo = [2.5e-11, LITERAL_BETA, 0.0][seed % 3], ("signed", "signed-time")[seed % 2]
    graph, network = T.RadiusGraph(radius=3, beta=beta, max_degree=k, pseudo=pseudo), trained(dim=2 + seed % 2)
    live = models.stream(network, window, graph)
    pieces, now = [], 0
    for _ in range(10):
        pieces.append(drawn(rng, int(rng.integers(1, 30)), ("burst", "ties", "narrow")[rng.integers(3)], now))
        now = int(pieces[-1].t[-1])
        live.feed(pieces[-1])
        events = of_window(joined(pieces), window)
        torch.testing.assert_close(live.scores(), whole(network, graph, events), atol=1e-5, rtol=0)


def test_pieces_may_be_of_any_size_and_rows_are_kept_where_that_pays():
    rng = np.random.default_rng(5)
    network, graph = trained(), T.RadiusGraph(max_degree=8)
    events = joined([drawn(rng, 900, "wide"), drawn(rng, 300, "narrow", 90_000)])
    live = models.stream(network, 60_000, graph)
    states, at = [], 0
    for size in (300, 1, 1, 1, 2, 1, 200, 1, 1, 1, 300, 390):
        live.feed(events[at : at + size])
        at += size
        torch.testing.assert_close(
            live.scores(), whole(network, graph, of_window(events[:at], 60_000)), atol=1e-5, rtol=0
        )
        states.append(live._live is not None)
    assert states == [False, False, True, True, True, True, False, False, True, True, False, False]
    assert live.products > 0


@pytest.mark.parametrize("many", [0, 10**9])
def test_the_graph_part_of_a_sequence_network_gives_grids(monkeypatch, many):
    monkeypatch.setattr(streaming, "MANY", many)
    monkeypatch.setattr(streaming, "CALM", 1)
    rng = np.random.default_rng(9)
    torch.manual_seed(0)
    network = models.RGCNN3D(
        3, sensor_size=(34, 34), channels=(4, 5), clusters=((2, 2), (7, 7)), temporal="plain"
    ).eval()
    graph = T.RadiusGraph(max_degree=5)
    live = models.stream(network, 2_000, graph)
    events = drawn(rng, 200, "narrow")
    for at in range(0, 200, 40):
        live.feed(events[at : at + 40])
        window = of_window(events[: at + 40], 2_000)
        with torch.no_grad():
            expected = network.grid(network.spatial(input_of(network, graph(window))))[0, :, 0]
        torch.testing.assert_close(live.grid(), expected, atol=1e-5, rtol=0)
    with pytest.raises(ValueError, match="RGCNN3D has no scores for one window: call grid"):
        live.scores()
    plain = models.stream(trained(), 2_000, graph)
    plain.feed(events)
    assert plain.grid().shape == (5, 5, 5)


def test_models_of_other_precision_stream_as_float32():
    rng = np.random.default_rng(4)
    events = drawn(rng, 80, "wide")
    exact = trained().double()
    live = models.stream(exact, None, GRAPHS[0])
    live.feed(events)
    assert live.scores().dtype == torch.float32
    torch.testing.assert_close(live.scores(), whole(exact, GRAPHS[0], events).float(), atol=1e-5, rtol=0)


def test_rows_that_are_given_up_after_a_late_start_leave_the_right_events():
    rng = np.random.default_rng(12)
    network, graph = trained(), GRAPHS[0]
    live = models.stream(network, 40_000, graph)
    events = joined([drawn(rng, 5, "wide"), drawn(rng, 400, "wide", 10**9)])
    states = []
    for start, stop in pairwise((0, 5, 200, 201, 202, 203, 204, 205, 405)):
        live.feed(events[start:stop])
        expected = whole(network, graph, of_window(events[:stop], 40_000))
        torch.testing.assert_close(live.scores(), expected, atol=1e-5, rtol=0)
        states.append(live._live is not None)
    assert states == [False, False, False, True, True, True, True, False]


def test_exact_streams_at_odd_metrics_windows_and_times(always):
    network, rng = trained(dim=3), np.random.default_rng(11)
    graph = T.RadiusGraph(pseudo="signed-time", max_degree=6)
    for gap in (2**40, 2**61):
        live = models.stream(network, 30_000, graph)
        live.feed(Events([0], [1], [1], [1], SIZE))
        live.scores()
        late = drawn(rng, 200, "narrow", gap)
        for at in range(0, 200, 20):
            live.feed(late[at : at + 20])
            found = live.scores()
        torch.testing.assert_close(found, whole(network, graph, of_window(late, 30_000)), atol=1e-5, rtol=0)
    for window in (2**63, 2**70, np.int64(2**63 - 1)):
        live = models.stream(trained(), window)
        live.feed(Events([0], [1], [1], [1], SIZE))
        live.feed(Events([2**61], [1], [1], [1], SIZE))
        assert len(live) == 2
    thin = T.RadiusGraph(radius=0.3, alpha=0.01, max_degree=6)
    live = models.stream(trained(), None, thin)
    events = Events([0, 0, 9], [0, 3, 5], [0, 0, 2], [1, 1, 0], SIZE)
    live.feed(events)
    torch.testing.assert_close(live.scores(), whole(trained(), thin, events), atol=1e-5, rtol=0)


def test_the_arrays_that_were_fed_may_be_used_again():
    columns = [np.arange(5), np.arange(5, dtype=np.int16), np.arange(5, dtype=np.int16), np.ones(5, np.uint8)]
    events = Events(*columns, SIZE)
    live = models.stream(trained(), None, GRAPHS[0])
    expected = whole(trained(), GRAPHS[0], Events(*(column.copy() for column in columns), SIZE))
    live.feed(events)
    for column in columns:
        column[:] = 0
    torch.testing.assert_close(live.scores(), expected, atol=1e-5, rtol=0)


def test_nothing_is_computed_before_scores_are_asked_for(monkeypatch):
    rng = np.random.default_rng(6)
    live = models.stream(trained(), 3_000)
    events = drawn(rng, 5_000, "wide")
    monkeypatch.setattr(streaming, "IncrementalNetwork", None)
    for at in range(0, 5_000, 10):
        live.feed(events[at : at + 10])
        # what is over isn't kept
        assert sum(piece.t.size for piece in live._waiting) < 400
    monkeypatch.undo()
    assert len(live) == len(of_window(events, 3_000))


def test_an_empty_window_and_a_gap_and_reset():
    network, graph = trained(), T.RadiusGraph()
    live = models.stream(network)
    empty = whole(network, graph, Events.empty(SIZE))
    assert torch.equal(live.scores(), empty)
    live.feed(Events.empty(SIZE))
    assert (len(live), live.products) == (0, 0)
    rng = np.random.default_rng(7)
    first, late = drawn(rng, 50, "wide"), drawn(rng, 20, "wide", 10**12)
    live.feed(first)
    torch.testing.assert_close(live.scores(), whole(network, graph, first), atol=1e-5, rtol=0)
    live.feed(late)
    assert len(live) == 20
    torch.testing.assert_close(live.scores(), whole(network, graph, late), atol=1e-5, rtol=0)
    live.reset()
    assert torch.equal(live.scores(), empty)
    # the clock begins anew
    live.feed(first)
    torch.testing.assert_close(live.scores(), whole(network, graph, first), atol=1e-5, rtol=0)


def test_a_burst_at_one_pixel_and_time(always):
    network, graph = trained(), T.RadiusGraph(max_degree=4)
    live = models.stream(network, 100, graph)
    count = 3_000
    burst = Events(np.full(count, 50), np.full(count, 5), np.full(count, 6), np.arange(count) % 2, SIZE)
    for at in range(0, count, 500):
        live.feed(burst[at : at + 500])
        live.scores()
    torch.testing.assert_close(live.scores(), whole(network, graph, burst), atol=1e-5, rtol=0)
    live.feed(Events([151], [5], [6], [1], SIZE))
    assert len(live) == 1


def test_rounding_does_not_add_up(always):
    rng = np.random.default_rng(8)
    network, graph = trained(2), T.RadiusGraph(max_degree=6)
    live = models.stream(network, 2_000, graph)
    events = drawn(rng, 6_000, "narrow")
    for at in range(6_000):
        live.feed(events[at : at + 1])
        live.scores()
    exact = whole(network.double(), graph, of_window(events, 2_000)).float()
    torch.testing.assert_close(live.scores(), exact, atol=1e-5, rtol=0)


def test_what_cannot_stream_is_reported():
    with pytest.raises(ValueError, match="a network in training mode can't stream: call eval"):
        models.stream(trained().train())
    with pytest.raises(ValueError, match=r"features\.0, a GCNConv, can't stream: B-spline convolutions can"):
        models.stream(models.GCNN(3, convolution="gcn").eval())
    with pytest.raises(ValueError, match="Linear can't stream: RGCNN and GCNN can"):
        models.stream(torch.nn.Linear(1, 1))
    with pytest.raises(ValueError, match="can't stream: its edges have no bound in space"):
        models.stream(trained(), graph=T.RadiusGraph(alpha=0.0))
    with pytest.raises(ValueError, match="can't stream: its edges have no bound in space"):
        models.stream(trained(), graph=T.KNNGraph(1))
    with pytest.raises(ValueError, match="takes 2 features of a node; a stream has its polarity alone"):
        models.stream(trained(in_channels=2))
    with pytest.raises(ValueError, match="3 pseudo-coordinates"):
        models.stream(trained(), graph=T.RadiusGraph(pseudo="signed-time"))
    with pytest.raises(ValueError, match="window must be"):
        models.stream(trained(), 0)
    live = models.stream(trained())
    with pytest.raises(ValueError, match="events of a sensor of 35x34, but the network is for 34x34"):
        live.feed(Events([1], [1], [1], [1], (35, 34)))
    live.feed(Events([7, 9], [1, 1], [1, 1], [1, 1], SIZE))
    live.feed(Events([9], [1], [1], [1], SIZE))
    with pytest.raises(ValueError, match="events go back in time: to 8 µs, after 9"):
        live.feed(Events([8], [1], [1], [1], SIZE))
    assert len(live) == 3


@pytest.mark.parametrize("window", [3_000, None])
def test_features_of_nodes_are_those_of_the_window(window):
    edges = T.Compose([T.RadiusGraph(max_degree=5)])
    graph = T.NodeFeatures(edges, [T.Patch(3), T.Age(), T.PatchMean(5)])
    network = trained(in_channels=1 + 18 + 1 + 2)
    live, done = models.stream(network, window, graph), 0
    assert torch.equal(live.scores(), whole(network, graph, Events.empty(SIZE)))
    events = drawn(np.random.default_rng(0), 300, "narrow", 10**12)
    for cut in (1, 2, 3, 150, 151, 152, 300):
        live.feed(events[done:cut])
        done = cut
        # as a recording's window in training, whose ages are shares of it
        last, fed = int(events.t[cut - 1]), Events(*events[:cut].columns, SIZE)
        fed = fed if window is None else fed.window(last + 1 - window, last + 1)
        assert torch.allclose(live.scores(), whole(network, graph, fed), atol=1e-6)
    assert live.grid().shape == (5, 5, 5)


def test_features_that_know_events_to_come_cannot_stream_causally():
    network = trained(clusters=(None, None, None, (7, 7)), in_channels=19)
    graph = T.NodeFeatures(T.Compose([T.RadiusGraph(causal=True)]), [T.Patch(3)])
    with pytest.raises(ValueError, match="on a causal graph: its features depend on later events"):
        models.stream(network, graph=graph)
    sampled = T.NodeFeatures(T.Compose([T.NonUniformSample(8), T.RadiusGraph()]), [T.Patch(3)])
    with pytest.raises(ValueError, match="isn't deterministic"):
        models.stream(network, graph=sampled)
    several = T.NodeFeatures(T.RadiusGraph(), [T.Patch(5)])
    with pytest.raises(ValueError, match="takes 19 features of a node; a stream has 51 on the given graph"):
        models.stream(trained(in_channels=19), graph=several)
