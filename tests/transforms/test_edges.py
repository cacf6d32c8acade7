"""Edges between the nodes of a graph: those that the thesis's author released, and other nodes than events."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from graphs import same
from hypothesis import given
from hypothesis import strategies as st
from places import SHARED
from strategies import events

from nvsdata import Events, GraphBatch
from nvsdata import transforms as T
from nvsdata.data.author_graphs import read_author_graphs
from nvsdata.transforms.events.sampling import BETA, LITERAL_BETA

FOLDER = SHARED / "author_graphs"
RADIUS = sorted((FOLDER / "cifar10-dvs").glob("*.mat"))
NEAREST = sorted((FOLDER / "ucf101-dvs").glob("*.mat"))


@pytest.mark.skipif(not RADIUS, reason="no released graphs here")
@pytest.mark.parametrize("path", RADIUS, ids=lambda path: path.stem)
def test_a_radius_graph_has_the_released_edges_and_no_others(path):
    (released,) = read_author_graphs(path)
    # the files have no times; without any, pixels that are exactly 3 apart would be joined
    nodes = replace(released, t=torch.arange(released.num_nodes))
    graph = T.RadiusGraph()(nodes)
    assert released.num_edges > 1_000
    assert torch.equal(graph.edge_index, released.edge_index)
    assert torch.equal(graph.edge_attr, released.edge_attr)
    # read literally, 2 ms are further than 3 pixels
    assert T.RadiusGraph(beta=LITERAL_BETA)(replace(nodes, t=nodes.t * 2_000)).num_edges == 0
    assert T.RadiusGraph(max_degree=99)(released).num_edges > released.num_edges


@pytest.mark.skipif(not NEAREST, reason="no released graphs here")
@pytest.mark.parametrize("path", NEAREST, ids=lambda path: path.stem)
def test_a_nearest_neighbor_graph_has_the_released_edges_and_no_others(path):
    for released in read_author_graphs(path):
        graph = T.KNNGraph()(released)
        assert torch.equal(graph.edge_index, released.edge_index)
        assert torch.equal(graph.edge_attr, released.edge_attr)


def nodes_of(ev):
    """The events as the nodes of a graph without edges."""
    return replace(T.RadiusGraph(radius=0.5)(ev), edge_index=torch.empty((2, 0), dtype=torch.int64))


KINDS = ("abs", "signed", "signed-time")
ways = st.sampled_from(
    [
        *(T.RadiusGraph(max_degree=4, pseudo=kind) for kind in KINDS),
        T.RadiusGraph(beta=LITERAL_BETA, pseudo="signed-time", reach_t=700),
        *(T.KNNGraph(3, pseudo=kind) for kind in KINDS),
    ]
)


@given(events(max_size=60), ways)
def test_nodes_of_a_graph_are_joined_as_events_are(ev, join):
    same(join(nodes_of(ev)), join(ev))


@given(events(max_size=60), ways, st.randoms(use_true_random=False))
def test_nodes_may_be_in_any_order(ev, join, random):
    # at different times, because of simultaneous ones the order decides
    ev = Events(ev.t + np.arange(len(ev)), ev.x, ev.y, ev.p, ev.sensor_size)
    expected = join(ev)
    order = list(range(len(ev)))
    random.shuffle(order)
    nodes = nodes_of(ev)
    shuffled = join(replace(nodes, x=nodes.x[order], pos=nodes.pos[order], t=nodes.t[order]))
    old = torch.tensor(order, dtype=torch.int64)
    source, target = shuffled.edge_index
    assert (target.diff() >= 0).all()
    assert ((source.diff() > 0) | (target.diff() > 0)).all()

    def named(edges, attributes):
        return sorted(zip(*edges.tolist(), attributes.tolist(), strict=True))

    assert named(old[shuffled.edge_index], shuffled.edge_attr) == named(expected.edge_index, expected.edge_attr)


@pytest.mark.parametrize("beta", [BETA, LITERAL_BETA])
@pytest.mark.parametrize("by", [(-7.0, -3.0), (-1_000.0, 0.0), (40_000.0, 70_000.0)])
def test_nodes_may_lie_anywhere(by, beta):
    random = np.random.default_rng(0)
    # few at a time, so that both ways to find neighbors are met
    ev = Events(np.arange(400) * 100, *random.integers(0, 20, (2, 400)), np.zeros(400, int), (34, 34))
    graph = T.RadiusGraph(beta=beta)(ev)
    moved = T.RadiusGraph(beta=beta)(replace(graph, pos=graph.pos + torch.tensor(by)))
    assert graph.num_edges > 300
    assert torch.equal(moved.edge_index, graph.edge_index)
    assert torch.allclose(moved.edge_attr, graph.edge_attr, atol=1e-3)


def test_what_has_no_neighbors():
    ev = Events([1, 2, 3], [1, 2, 3], [1, 1, 1], [0, 1, 0], (9, 9))
    graph = T.RadiusGraph()(ev)
    for odd in (np.nan, np.inf, -np.inf, 1e6):
        pos = graph.pos.clone()
        pos[1, 0] = odd
        with pytest.raises(ValueError, match="nodes must be at finite positions, at most 32767 pixels apart"):
            T.RadiusGraph()(replace(graph, pos=pos))
    with pytest.raises(TypeError, match=r"sample must be Events, a Recording or a single graph, not GraphBatch"):
        T.KNNGraph()(GraphBatch.of(graph))
    for join, message in (
        (lambda: T.RadiusGraph(max_degree=0)(ev), "max_degree must be a whole number of at least 1, not 0"),
        (lambda: T.RadiusGraph(float("nan"))(ev), "radius must be positive, not nan"),
        (lambda: T.KNNGraph(1.5)(ev), "k must be a whole number of at least 1, not 1.5"),
        (lambda: T.KNNGraph(reach=0)(ev), "reach must be positive, not 0"),
        (lambda: T.KNNGraph(pseudo="polar")(ev), "pseudo must be one of .*, not 'polar'"),
    ):
        with pytest.raises(ValueError, match=message):
            join()


def test_more_neighbors_than_there_are_nodes():
    ev = Events([1, 2, 3], [1, 2, 30], [1, 1, 1], [0, 1, 0], (40, 9))
    for k in (2, 3, 10**9, 2.0):
        assert T.KNNGraph(k)(ev).edge_index.tolist() == [[1, 2, 0, 2, 0, 1], [0, 0, 1, 1, 2, 2]]
    for n, shape in ((0, (0, 3)), (1, (0, 3)), (2, (2, 3))):
        assert T.KNNGraph(5, pseudo="signed-time")(ev[:n]).edge_attr.shape == shape


def test_more_neighbors_than_there_are_is_all_of_them():
    ev = Events([0, 1, 2], [0, 1, 2], [0, 0, 0], [1, 0, 1], (4, 3))
    assert T.RadiusGraph(max_degree=10**30)(ev).edge_index.equal(T.RadiusGraph(max_degree=2)(ev).edge_index)
    assert T.KNNGraph(10**30)(ev).edge_index.equal(T.KNNGraph(2)(ev).edge_index)
