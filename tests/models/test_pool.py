from dataclasses import replace

import numpy as np
import pytest
import torch
from by_hand import slow_pool
from hypothesis import given
from hypothesis import strategies as st
from strategies import events

from nvsdata import GraphBatch
from nvsdata.models import GraphPool
from nvsdata.models import clusters as module
from nvsdata.models.pool import coarse_reach
from nvsdata.transforms import RadiusGraph, affine


@st.composite
def batches(draw):
    graphs = [RadiusGraph()(draw(events(max_size=60, gap=300))) for _ in range(draw(st.integers(1, 4)))]
    turned = [affine(graph, degrees=draw(st.sampled_from((0, 0, 30)))) for graph in graphs]
    batch = GraphBatch.from_graphs(turned)
    generator = torch.Generator().manual_seed(draw(st.integers(0, 1000)))
    x = torch.randn(batch.num_nodes, 3, generator=generator)
    return replace(batch, x=x)


@pytest.mark.parametrize("on", ["kernels", "torch"])
@pytest.mark.parametrize("mode", ["max", "average"])
@given(batch=batches(), cluster=st.sampled_from(((2, 2), (4, 3), (7, 7), (40, 40))))
def test_pooling_is_that_of_brute_force(on, mode, batch, cluster):
    pool = GraphPool(cluster, (34, 34), mode)
    if on == "torch":
        index, pos, _, graph_of, _, edges = module.clusters_torch(batch, cluster, pool.grid)
        x = (
            module.max_rows_torch(batch.x, index, len(pos))
            if mode == "max"
            else module.mean_rows_torch(batch.x, index, len(pos))
        )
    else:
        out = pool(batch)
        x, pos, edges, graph_of = out.x, out.pos, out.edge_index, out.batch
    nodes, slow_edges = slow_pool(batch, cluster, pool.grid, mode)
    names = sorted(nodes)
    assert len(pos) == len(names)
    for i, name in enumerate(names):
        assert graph_of[i] == name[0]
        assert pos[i].tolist() == list(nodes[name][:2])
        assert torch.allclose(x[i].double(), nodes[name][3], atol=1e-6)
    ours = [(names[a], names[b]) for a, b in zip(*edges.tolist(), strict=True)]
    assert len(ours) == len(set(ours))
    assert set(ours) == slow_edges


@given(batch=batches(), cluster=st.sampled_from(((2, 2), (4, 3), (7, 7), (40, 40))))
def test_both_ways_of_clustering_give_the_same_graphs(batch, cluster):
    grid = GraphPool(cluster, (34, 34)).grid
    ours, other = (way(batch, cluster, grid) for way in (module.clusters_cpu, module.clusters_torch))
    for a, b in zip(ours, other, strict=True):
        assert a.dtype == b.dtype
        assert torch.equal(a, b)


@pytest.mark.parametrize("mode", ["max", "average"])
@given(batch=batches())
def test_the_gradient_of_a_cluster_goes_to_its_maximum_or_to_all_alike(mode, batch):
    pool = GraphPool((4, 4), (34, 34), mode)
    index, pos = module.clusters_torch(batch, (4, 4), pool.grid)[:2]
    a, b = batch.x.clone().requires_grad_(), batch.x.clone().requires_grad_()
    upstream = torch.randn(len(pos), 3)
    pool(replace(batch, x=a)).x.backward(upstream)
    reduce = {"max": module.max_rows_torch, "average": module.mean_rows_torch}[mode]
    reduce(b, index, len(pos)).backward(upstream)
    expected = torch.zeros_like(batch.x)
    for cluster in range(len(pos)):
        members = [node for node in range(batch.num_nodes) if index[node] == cluster]
        for channel in range(3):
            if mode == "average":
                expected[members, channel] = upstream[cluster, channel] / len(members)
            else:
                # random features are never equal
                largest = max(members, key=lambda node: batch.x[node, channel].item())
                expected[largest, channel] = upstream[cluster, channel]
    for found in (a.grad, b.grad):
        torch.testing.assert_close(found, expected)


@pytest.mark.parametrize("on", ["kernels", "torch"])
@given(
    values=st.lists(st.sampled_from((1.0, 2.0, -1.0, np.nan, np.inf, -np.inf)), min_size=1, max_size=12),
    data=st.data(),
)
def test_nan_is_more_than_any_number_in_any_order(on, values, data):
    x = torch.tensor(values).unsqueeze(1).requires_grad_()
    index = torch.tensor(data.draw(st.lists(st.integers(0, 2), min_size=len(values), max_size=len(values))))
    index = torch.unique(index, return_inverse=True)[1]
    count = int(index.max()) + 1
    ways = {"kernels": module._MaxRows.apply, "torch": module.max_rows_torch}
    best = ways[on](x, index, count)
    best.sum().backward()
    for m in range(count):
        members = [i for i in range(len(values)) if index[i] == m]
        odd = [i for i in members if np.isnan(values[i])]
        first = odd[0] if odd else max(members, key=lambda i: values[i])
        torch.testing.assert_close(best[m, 0].detach(), torch.tensor(values[first]), equal_nan=True)
        assert [i for i in members if x.grad[i, 0]] == [first]


@pytest.mark.parametrize("odd", [np.nan, np.inf, -np.inf])
def test_nodes_that_are_nowhere_are_clustered_alike(odd):
    from nvsdata import Events

    batch = GraphBatch.of(RadiusGraph()(Events(range(4), [1, 2, 9, 30], [1, 2, 9, 30], [0] * 4, (34, 34))))
    batch.pos[1, 0] = odd
    ours, other = (way(batch, (4, 4), (9, 9)) for way in (module.clusters_cpu, module.clusters_torch))
    assert ours.cluster.tolist() == other.cluster.tolist()
    assert ours.cluster.min() >= 0
    torch.testing.assert_close(ours.pos, other.pos, equal_nan=True)


def test_pseudo_coordinates_lie_in_0_1_and_depend_on_the_graph_alone():
    from nvsdata import Events

    rng = np.random.default_rng(0)
    graphs = [
        RadiusGraph()(
            Events(np.arange(99), rng.integers(0, 34, 99), rng.integers(0, 34, 99), np.zeros(99, int), (34, 34))
        )
        for _ in range(3)
    ]
    pool = GraphPool((4, 4), (34, 34))
    alone = pool(GraphBatch.from_graphs(graphs[:1]))
    together = pool(GraphBatch.from_graphs(graphs))
    assert torch.equal(together.edge_attr[: alone.num_edges], alone.edge_attr)
    assert together.edge_attr.min() >= 0
    assert together.edge_attr.max() <= 1


def test_times_are_averaged():
    from nvsdata import Events

    out = GraphPool((34, 34), (34, 34))(
        GraphBatch.of(RadiusGraph()(Events([10, 21], [1, 2], [1, 2], [0, 1], (34, 34))))
    )
    assert out.t.tolist() == [5]


def test_bad_settings_are_refused():
    with pytest.raises(ValueError, match="cluster must be"):
        GraphPool((0, 2), (34, 34))
    with pytest.raises(ValueError, match="mode must be"):
        GraphPool((2, 2), (34, 34), "median")


def test_pseudo_coordinates_reach_as_far_as_a_cluster_or_as_before():
    assert coarse_reach((3.0, 3.0), (2, 4)) == (3, 4)
    assert coarse_reach((3.0, 3.0, 15_000), (4, 2)) == (4, 3, 15_000)
