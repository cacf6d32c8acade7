import sys
from dataclasses import replace

import numpy as np
import pytest
import torch
from graphs import same
from hypothesis import given
from hypothesis import strategies as st

import nvsdata
from nvsdata import Events, Graph, GraphBatch, models
from nvsdata.data.graph import grouped, sequence_of
from nvsdata.transforms import RadiusGraph


def graph(n=5, radius=3.0):
    return RadiusGraph(radius)(Events(np.arange(n), np.arange(n), np.arange(n), np.arange(n) % 2, (34, 34)))


def test_nodes_carry_polarity_position_and_time_since_the_window():
    window = Events([100, 200], [3, 4], [5, 6], [0, 1], (34, 34)).window(90, 300)
    g = RadiusGraph()(window)
    assert g.x.tolist() == [[-1.0], [1.0]]
    assert g.pos.tolist() == [[3.0, 5.0], [4.0, 6.0]]
    assert g.t.tolist() == [10, 110]
    assert (g.x.dtype, g.pos.dtype, g.t.dtype) == (torch.float32, torch.float32, torch.int64)
    assert g.edge_index.tolist() == [[1, 0], [0, 1]]
    assert torch.allclose(g.edge_attr, torch.tensor([[2 / 3, 2 / 3], [1 / 3, 1 / 3]]))
    assert torch.allclose(RadiusGraph(pseudo="abs")(window).edge_attr, torch.full((2, 2), 1 / 3))
    timed = RadiusGraph(pseudo="signed-time", reach_t=200)(window).edge_attr
    assert torch.allclose(timed, torch.tensor([[2 / 3, 2 / 3, 3 / 4], [1 / 3, 1 / 3, 1 / 4]]))


def test_a_batch_shifts_edges_and_knows_its_graphs():
    a, b = graph(5), graph(3)
    batch = GraphBatch.from_graphs([a, b])
    assert batch.ptr.tolist() == [0, 5, 8]
    assert batch.batch.tolist() == [0] * 5 + [1] * 3
    assert torch.equal(batch.edge_index[:, a.num_edges :], b.edge_index + 5)
    assert batch.num_graphs == 2


def test_graphs_of_different_reach_do_not_mix():
    with pytest.raises(ValueError, match="different reach"):
        GraphBatch.from_graphs([graph(radius=3), graph(radius=4)])


def test_collate_makes_batches_and_targets():
    batch, targets = nvsdata.collate([(graph(5), 3), (graph(2), 1)])
    assert isinstance(batch, GraphBatch)
    assert targets.tolist() == [3, 1]
    assert targets.dtype == torch.int64


def test_collate_of_sequences_counts_volumes():
    batch, _ = nvsdata.collate([([graph(5), graph(2)], 0), ([graph(1), graph(4)], 1)])
    assert batch.volumes == 2
    assert batch.ptr.tolist() == [0, 5, 7, 8, 12]
    with pytest.raises(ValueError, match="different lengths"):
        nvsdata.collate([([graph(5)], 0), ([graph(1), graph(4)], 1)])


def test_collate_of_other_samples():
    ev = Events([1], [1], [1], [1])
    assert nvsdata.collate([(ev, 0), (ev, 1)])[0] == [ev, ev]
    assert nvsdata.collate([(torch.ones(2), 0), (torch.ones(2), 1)])[0].shape == (2, 2)
    with pytest.raises(ValueError, match="no samples"):
        nvsdata.collate([])


@given(
    st.lists(st.integers(0, 12), min_size=1, max_size=6),
    st.booleans(),
    st.sampled_from([None, (34, 34)]),
    st.floats(1, 9),
)
def test_a_batch_gives_its_graphs_back(sizes, labeled, sensor_size, radius):
    graphs = [
        replace(graph(n, radius), y=i % 3 if labeled else None, sensor_size=sensor_size) for i, n in enumerate(sizes)
    ]
    batch = GraphBatch.from_graphs(graphs)
    assert all(map(same, graphs, batch.to_graphs()))
    for i in range(-len(graphs), len(graphs)):
        same(graphs[i], batch[i])
    same(GraphBatch.from_graphs(batch.to_graphs()), batch)


def test_graphs_of_a_batch_whose_edges_are_in_any_order():
    batch = GraphBatch.from_graphs([graph(5), graph(3), graph(4)])
    order = torch.randperm(batch.num_edges)
    mixed = replace(batch, edge_index=batch.edge_index[:, order], edge_attr=batch.edge_attr[order])
    for one, other, expected in zip(
        mixed.to_graphs(), map(mixed.__getitem__, range(3)), batch.to_graphs(), strict=True
    ):
        same(one, other)
        assert sorted(one.edge_index.T.tolist()) == sorted(expected.edge_index.T.tolist())


def test_graphs_that_a_batch_does_not_have():
    batch = GraphBatch.of(graph())
    for number in (1, -2):
        with pytest.raises(IndexError, match=f"no graph {number} in a batch of 1"):
            batch[number]
    with pytest.raises(TypeError):
        batch[0:1]
    assert len(list(batch)) == 1


@pytest.mark.parametrize("other", [lambda: torch.ones(2, 1), lambda: [graph()], lambda: None])
def test_networks_say_what_they_take(other):
    with pytest.raises(TypeError, match="graphs must be a Graph or a GraphBatch, not "):
        models.rgcnn("n-mnist")(other())


def test_moving_to_a_device_keeps_all():
    batch = GraphBatch.of(graph()).to("cpu")
    assert batch.reach == (3.0, 3.0)
    assert batch.sensor_size == (34, 34)


def test_what_graphs_say_of_themselves():
    a, b = graph(5), graph(3)
    batch = GraphBatch.from_graphs([a, b])
    assert (a.num_nodes, a.num_edges, b.num_edges) == (5, 14, 6)
    assert repr(a) == "Graph(5 nodes, 14 edges)"
    assert repr(batch) == "GraphBatch(2 graphs, 8 nodes, 20 edges)"
    assert (batch.num_nodes, batch.num_edges, batch.volumes) == (8, 20, 1)
    assert GraphBatch.from_graphs([a, b], volumes=2).volumes == 2
    bare = Graph(a.x, a.pos, a.t, a.edge_index, a.edge_attr)
    assert (bare.y, bare.sensor_size, bare.reach, bare.pseudo) == (None, None, (3.0, 3.0), "abs")
    with pytest.raises(ValueError, match=r"^a batch needs at least one graph$"):
        GraphBatch.from_graphs([])


def test_a_batch_is_as_large_as_its_largest_and_labeled_if_all_are():
    a, b, c = (replace(graph(2), sensor_size=size, y=y) for size, y in (((9, 3), 4), ((4, 7), 5), (None, None)))
    assert GraphBatch.from_graphs([a, b]).sensor_size == (9, 7)
    assert GraphBatch.from_graphs([c, b]).sensor_size == (4, 7)
    assert GraphBatch.from_graphs([c, c]).sensor_size is None
    assert GraphBatch.from_graphs([a, b]).y.tolist() == [4, 5]
    assert GraphBatch.from_graphs([a, c]).y is None
    several = replace(GraphBatch.from_graphs([a, b]), y=torch.tensor([[1, 2], [3, 4]]))
    assert several[1].y.tolist() == several.to_graphs()[1].y.tolist() == [3, 4]


def test_what_is_a_batch_of_one():
    batch = GraphBatch.of(graph())
    assert GraphBatch.of(batch) is batch
    assert batch.ptr.tolist() == [0, 5]
    with pytest.raises(TypeError, match="graphs must be a Graph or a GraphBatch, not str:"):
        GraphBatch.of("graph")


def test_edges_are_grouped_by_their_target():
    edges, u = torch.tensor([[0, 1, 2, 3], [2, 0, 2, 0]]), torch.arange(8.0).reshape(4, 2)
    source, target, attributes = grouped(edges, u, 4)
    assert (source.tolist(), target.tolist()) == ([1, 3, 0, 2], [0, 0, 2, 2])
    assert attributes.tolist() == [[2, 3], [6, 7], [0, 1], [4, 5]]
    # those of one target stay in order
    many = torch.stack((torch.arange(3_000), torch.arange(3_000) % 2))
    assert grouped(many, torch.zeros(3_000, 2), 3_000)[0].tolist() == [*range(0, 3_000, 2), *range(1, 3_000, 2)]
    # what is in order already stays where it is
    assert grouped(torch.stack((source, target)), attributes, 4)[2].data_ptr() == attributes.data_ptr()
    for wrong, nodes, message in (
        (u[:3], 4, "edge_attr has 3 rows for 4 edges"),
        (u, 3, "edge_index names nodes from 0 to 3; there are 3"),
        (u / 0, 4, "edge_attr has numbers that are not finite"),
    ):
        with pytest.raises(ValueError, match=f"^{message}$"):
            grouped(edges, wrong, nodes)
    assert grouped(torch.tensor([[3], [0]]), u[:1], 4)[0].tolist() == [3]
    with pytest.raises(ValueError, match="names nodes from -1 to 0; there are 4"):
        grouped(torch.tensor([[-1], [0]]), u[:1], 4)


def test_a_sequence_is_a_list_or_tuple_of_graphs():
    a, b = graph(1), graph(2)
    assert sequence_of((a, b)) == sequence_of([a, b]) == [a, b]
    for wrong in (a, [a, 5], "ab", iter([a])):
        with pytest.raises(TypeError, match="graphs must be a Graph or a list of them, not "):
            sequence_of(wrong)


def test_without_pytorch_geometric(monkeypatch):
    monkeypatch.setitem(sys.modules, "torch_geometric.data", None)
    for each in (graph(1), GraphBatch.of(graph(1))):
        with pytest.raises(ImportError, match=r"to_pyg needs PyTorch Geometric: pip install 'nvsdata\[pyg\]'"):
            each.to_pyg()
