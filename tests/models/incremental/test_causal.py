"""Networks on causal graphs: edges against their definition, streams against the network on all events."""

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from test_streaming import SIZE, drawn, joined, trained, whole

from nvsdata import Events, models
from nvsdata import transforms as T
from nvsdata.data.graph import Graph
from nvsdata.data.pseudo import pseudo
from nvsdata.models.graph_cnn import input_of
from nvsdata.transforms.events.sampling import LITERAL_BETA

SHAPE = {"channels": (5, 6, 7), "clusters": (None, None, (7, 7)), "hidden": 8}


def earlier(graph, events, window=None):
    """The edges of a causal graph by definition; sources are at most so old."""
    found = []
    for i in range(len(events)):
        near = []
        for j in range(i):
            gap = int(events.t[i] - events.t[j])
            apart = (int(events.x[i]) - int(events.x[j])) ** 2 + (int(events.y[i]) - int(events.y[j])) ** 2
            far = graph.alpha * apart + graph.beta * (float(gap) * float(gap))
            if far <= graph.radius**2 and (window is None or gap < window):
                near.append((far, gap, j))
        found += [(j, i) for j in sorted(j for *_, j in sorted(near)[: graph.max_degree])]
    return torch.tensor(found, dtype=torch.int64).reshape(-1, 2).T


def forgetting(network, graph, events, window):
    """Scores of the maxima over the last `window` µs, where all rows know their neighbors."""
    plain = graph(events)
    edges = earlier(graph, events, window)
    made = Graph(
        plain.x, plain.pos, plain.t, edges, pseudo(plain.pos, plain.t, edges, plain.reach, graph.pseudo), None, SIZE,
        plain.reach, graph.pseudo,
    )  # fmt: skip
    with torch.no_grad():
        batch = network.features[:-2](input_of(network, made))
        kept = events.t > events.t[-1] - window
        columns, rows = network.grid
        flat = torch.zeros(columns * rows, batch.x.shape[1])
        for row, x, y in zip(batch.x[torch.from_numpy(kept)], events.x[kept] // 7, events.y[kept] // 7, strict=True):
            cell = int(y) * columns + int(x)
            flat[cell] = torch.maximum(flat[cell], row)
        return network.classify(torch.relu(network.hidden(flat.reshape(1, -1))))[0]


GRAPHS = [
    T.RadiusGraph(max_degree=4, causal=True),
    T.RadiusGraph(max_degree=50, causal=True, pseudo="abs", alpha=1.5),
    T.RadiusGraph(max_degree=3, causal=True, beta=LITERAL_BETA, pseudo="signed-time"),
]


@pytest.mark.parametrize("graph", GRAPHS, ids=str)
@settings(max_examples=8, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_edges_lead_from_earlier_events(graph, seed):
    rng = np.random.default_rng(seed)
    events = joined([drawn(rng, 30, "ties"), drawn(rng, 40, "burst", 10**4), drawn(rng, 30, "narrow", 10**5)])
    found = graph(events)
    assert torch.equal(found.edge_index, earlier(graph, events))
    plain = T.RadiusGraph(max_degree=3)(events)
    for name in ("x", "pos", "t", "sensor_size", "reach"):
        ours, theirs = getattr(found, name), getattr(plain, name)
        assert torch.equal(ours, theirs) if isinstance(ours, torch.Tensor) else ours == theirs or name == "reach"
    # nodes of a graph in another order
    order = torch.randperm(100)
    mixed = graph(Graph(plain.x[order], plain.pos[order], plain.t[order], plain.edge_index[:, :0], plain.edge_attr[:0]))
    t = mixed.t[mixed.edge_index]
    assert (t[0] <= t[1]).all()


def test_few_events_and_bad_settings():
    graph = T.RadiusGraph(causal=True)
    assert graph(Events.empty(SIZE)).num_nodes == 0
    assert graph(Events([5], [1], [1], [1], SIZE)).edge_index.shape == (2, 0)
    assert torch.equal(graph(Events([5, 5], [1, 2], [1, 1], [1, 0], SIZE)).edge_index, torch.tensor([[0], [1]]))
    with pytest.raises(ValueError, match="a causal graph needs alpha above 0"):
        T.RadiusGraph(alpha=0.0, causal=True)


@pytest.mark.parametrize("graph", GRAPHS, ids=str)
@settings(max_examples=8, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), window=st.sampled_from([None, 40, 3_000]))
def test_scores_are_those_of_all_events_however_they_are_cut(graph, seed, window):
    rng = np.random.default_rng(seed)
    network = trained(seed % 5, dim=3 if graph.pseudo == "signed-time" else 2, **SHAPE)
    live = models.stream(network, window, graph)
    pieces, now = [], int(rng.integers(-(10**6), 10**15))
    for _ in range(6):
        kind = ("wide", "narrow", "burst", "slow", "ties")[rng.integers(5)]
        pieces.append(drawn(rng, int(rng.integers(1, 30)), kind, now))
        now = int(pieces[-1].t[-1])
        live.feed(pieces[-1])
        events = joined(pieces)
        expected = whole(network, graph, events) if window is None else forgetting(network, graph, events, window)
        torch.testing.assert_close(live.scores(), expected, atol=1e-5, rtol=0)
        assert len(live) == (len(events) if window is None else int((events.t > events.t[-1] - window).sum()))
    assert live.products > 0


def test_long_pieces_and_single_events_give_the_same(monkeypatch):
    rng = np.random.default_rng(1)
    network = trained(1, **SHAPE)
    events = joined([drawn(rng, 3_000, "wide"), drawn(rng, 1_500, "narrow", 10**6)])
    found = []
    for size, together in ((1, 4096), (4_500, 4096), (700, 90)):
        monkeypatch.setattr("nvsdata.kernels.streaming.causal.TOGETHER", together)
        live = models.stream(network, 20_000, GRAPHS[0])
        for at in range(0, 4_500, size):
            live.feed(events[at : at + size])
        found.append(live.scores())
    for other in found[1:]:
        torch.testing.assert_close(found[0], other, atol=1e-6, rtol=0)


def test_a_window_ends_with_what_was_fed_though_the_sampler_dropped_it():
    network = trained(1, **SHAPE)
    live = models.stream(network, 1_000, GRAPHS[0], T.RefractoryPeriod(10**9))
    live.feed(Events([0], [3], [3], [1], SIZE))
    assert len(live) == 1
    live.feed(Events([10**6], [3], [3], [1], SIZE))
    assert len(live) == 0
    torch.testing.assert_close(live.scores(), whole(network, GRAPHS[0], Events.empty(SIZE)))


def test_odd_metrics_and_degrees():
    two = Events([5, 5], [0, 3], [0, 0], [1, 1], SIZE)
    # exactly at the radius, though the quotient is rounded down
    assert T.RadiusGraph(radius=0.3, alpha=0.01, causal=True)(two).edge_index.tolist() == [[0], [1]]
    assert T.RadiusGraph(alpha=1e-12, causal=True)(two).edge_index.tolist() == [[0], [1]]
    # many neighbors
    busy = Events(np.arange(900), np.full(900, 4), np.full(900, 4), np.zeros(900), SIZE)
    counts = torch.bincount(T.RadiusGraph(max_degree=10**6, causal=True)(busy).edge_index[1], minlength=900)
    assert counts.tolist() == list(range(900))
    assert T.RadiusGraph(max_degree=300, causal=True)(busy).edge_index.shape[1] == 300 * 299 // 2 + 600 * 300
    with pytest.raises(ValueError, match="max_degree must be at most 1,024"):
        models.stream(trained(**SHAPE), graph=T.RadiusGraph(max_degree=10**6, causal=True))
    far = Graph(torch.ones(2, 1), torch.tensor([[0.0, 0.0], [32_767, 32_767]]), torch.zeros(2, dtype=torch.int64),
                torch.empty((2, 0), dtype=torch.int64), torch.empty(0, 2))  # fmt: skip
    with pytest.raises(ValueError, match="nodes of a causal graph must be within 67,108,864 pixels, not 32768x32768"):
        GRAPHS[0](far)


def test_reset_and_an_empty_window():
    rng = np.random.default_rng(2)
    network = trained(1, **SHAPE)
    live = models.stream(network, 1_000, GRAPHS[0])
    empty = whole(network, GRAPHS[0], Events.empty(SIZE))
    torch.testing.assert_close(live.scores(), empty)
    live.feed(drawn(rng, 100, "wide"))
    assert not torch.equal(live.scores(), empty)
    live.reset()
    torch.testing.assert_close(live.scores(), empty)
    assert (len(live), live.products) == (0, 0)


def test_what_cannot_stream_is_reported():
    with pytest.raises(ValueError, match="pooling before the last block can't stream on a causal graph"):
        models.stream(trained(), graph=GRAPHS[0])
    with pytest.raises(ValueError, match="a first block without pooling can stream on a causal graph only"):
        models.stream(trained(**SHAPE), graph=T.RadiusGraph())
    with pytest.raises(ValueError, match="can't stream on a causal graph: mode 'max' can"):
        models.stream(trained(**SHAPE, pooling="average"), graph=GRAPHS[0])
    with pytest.raises(ValueError, match="the last entry of clusters can't be None"):
        models.RGCNN(3, clusters=((2, 2), (4, 4), None))


def test_networks_without_pooling_between_train_as_others_do():
    rng = np.random.default_rng(3)
    network = models.GCNN(2, **SHAPE)
    optimizer = torch.optim.Adam(network.parameters(), 0.02)
    # those that are to be told apart lie elsewhere
    samples = [(drawn(rng, 40, "narrow"), 0) for _ in range(4)]
    samples += [(Events(e.t, e.x, 33 - e.y, e.p, SIZE), 1) for e, _ in samples]
    for _ in range(30):
        loss = sum(
            torch.nn.functional.cross_entropy(network(GRAPHS[0](e)), torch.tensor([label])) for e, label in samples
        )
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
    assert float(loss) < 1.0
