"""Layers of graph networks: they touch the nodes, edges and kernel cells that there are."""

import numpy as np
import pytest

from nvsdata.kernels import _native
from nvsdata.kernels.graph import pool, spline

counted = pytest.mark.skipif(not _native.checks_bounds, reason="only a build that checks indexes counts them")

SIZE, DIM, CHANNELS = 5, 2, 3
NODES, EDGES = 60, 150


def graph(nodes=NODES, edges=EDGES):
    """Edges between the first nodes, by target, and pseudo-coordinates: some on a cell of the kernel exactly."""
    rng = np.random.default_rng(0)
    source, target = rng.integers(0, NODES, edges), np.sort(rng.integers(0, NODES, edges))
    u = rng.random((edges, DIM), np.float32)
    # the last rows of cells have no share
    u[:, 1] *= 0.6
    u[::5] = 0.25
    u[1::7, 0] = 1
    return source, target, u, SIZE, nodes


def pairs(source, target, u, size, nodes):
    """Of each edge the cells with a share, one by one: (target, cell)."""
    found = []
    for node, place in zip(target.tolist(), (u * (size - 1)).tolist(), strict=True):
        for x in range(size):
            for y in range(size):
                if abs(place[0] - x) < 1 and abs(place[1] - y) < 1:
                    found.append((node, x + size * y))
    return found


def touched(function, *arguments):
    """Elements that a call touches, and its result."""
    _native.touched()
    found = function(*arguments)
    return _native.touched(), found


def test_a_plan_has_the_pairs_of_node_and_cell_that_edges_use():
    found = pairs(*graph())
    starts, rows, entries, *_ = spline.spline_plan(*graph())
    assert len(entries) == len(found)
    assert len(rows) == len(set(found))
    assert np.count_nonzero(np.diff(starts)) == len({cell for _, cell in found})


@counted
@pytest.mark.parametrize("edges", [EDGES, 4 * EDGES])
def test_a_plan_touches_each_edge_and_each_of_its_cells(edges):
    # of each corner of an edge a share is made, divided, counted and put into its row
    once, _ = touched(spline.spline_plan, *graph(edges=edges))
    assert once <= 28 * 2**DIM * edges + 8 * SIZE**DIM
    # lonely nodes cost nothing
    assert touched(spline.spline_plan, *graph(10 * NODES, edges))[0] == once


@counted
@pytest.mark.parametrize("channels", [1, 3, 6])
def test_each_entry_adds_its_channels_once(channels):
    source, target, u, size, nodes = graph()
    x = np.ones((nodes, channels), np.float32)
    _, rows, into, of, share = spline.spline_plan(*graph())
    adding = len(into) * 2 * channels
    # of an entry two indexes, the rows that they name, and a share
    out = np.zeros((len(rows), channels), np.float32)
    assert touched(spline.add_shares, out, into, x, of, share)[0] <= adding + 5 * len(into) + 16
    # edges share out and add in one go
    cost, sums = touched(spline.dense_sums, source, target, u, size, x)
    assert cost <= adding + 21 * 2**DIM * EDGES
    assert touched(spline.dense_gradient, source, target, u, size, sums, nodes)[0] <= adding + 21 * 2**DIM * EDGES


def pooled(nodes, edges, grid, graphs=1):
    """What pooling touches: clusters, merged edges, and features; and the number of clusters."""
    rng = np.random.default_rng(0)
    # the same 16 x 16 clusters are occupied, however large the grid is
    pos = rng.integers(0, 64, (nodes, 2)).astype(np.float32)
    ptr = np.linspace(0, nodes, graphs + 1).astype(np.int64)
    clusters, (cluster, position, *_) = touched(pool.clusters, pos, np.zeros(nodes, np.int64), ptr, 4, 4, *grid)
    count = len(position)
    source, target = rng.integers(0, nodes, edges), np.sort(rng.integers(0, nodes, edges))
    merged, _ = touched(pool.merged_edges, source, target, cluster, count)
    x = rng.random((nodes, CHANNELS))
    largest, (best, where) = touched(pool.max_rows, x, cluster, count)
    back, _ = touched(pool.max_rows_back, best, where, nodes)
    mean, _ = touched(pool.mean_rows, x, cluster, count)
    return {"clusters": clusters, "merged": merged, "largest": largest, "back": back, "mean": mean}, count


@counted
@pytest.mark.parametrize("times", [1, 2, 4])
def test_pooling_visits_each_node_and_edge_once(times):
    nodes, edges = times * NODES, times * EDGES
    found, count = pooled(nodes, edges, (16, 16))
    # its place, the cell's cluster, and its share of the mean
    assert found["clusters"] <= 2 * 16 * 16 + 24 * nodes + 10 * count
    assert found["merged"] <= 8 * edges + 12 * nodes + 6 * count
    assert found["largest"] <= 5 * nodes * CHANNELS + 6 * nodes + count
    assert found["mean"] <= 2 * nodes * CHANNELS + 7 * nodes + count * (2 * CHANNELS + 4)
    assert found["back"] <= count * (4 * CHANNELS + 2)


@counted
def test_pooling_looks_once_at_each_cell_of_a_graph_however_large_the_sensor():
    nodes = pooled(NODES, EDGES, (16, 16))[0]["clusters"] - 16 * 16
    for graphs in (1, 4):
        found, _ = pooled(NODES, EDGES, (100, 100), graphs)
        assert found["clusters"] <= graphs * 100 * 100 + 1.2 * nodes


@pytest.fixture
def batch():
    """Two graphs of events, with 24 features, and as many nodes without edges as are asked for."""
    import torch

    from nvsdata import GraphBatch
    from nvsdata.data.graph import Graph

    def made(lonely=0):
        source, target, u, _, _ = graph()
        nodes, generator = NODES + lonely, torch.Generator().manual_seed(0)
        one = Graph(
            x=torch.rand(nodes, 24, generator=generator),
            pos=torch.randint(0, 64, (nodes, 2), generator=generator).float(),
            t=torch.arange(nodes),
            edge_index=torch.from_numpy(np.stack((source, target))),
            edge_attr=torch.from_numpy(u),
            sensor_size=(64, 64),
        )
        return GraphBatch.from_graphs([one, one])

    return made


@pytest.mark.parametrize("lonely", [0, 500])
def test_a_convolution_multiplies_the_rows_of_pairs_that_occur(batch, lonely):
    import torch

    from nvsdata.models import SplineConv

    given, layer = batch(lonely), SplineConv(24, 7)
    found = pairs(*graph())
    rows, cells = 2 * len(set(found)), len({cell for _, cell in found})
    x = given.x.requires_grad_()
    with Products() as forward:
        out = layer(x, given.edge_index, given.edge_attr)
    assert all((inner, columns) == (24, 7) for _, inner, columns in forward.shapes)
    assert len(forward.shapes) == cells
    assert sum(n for n, _, _ in forward.shapes) == rows
    with Products() as back:
        out.sum().backward()
    assert len(back.shapes) == 2 * cells
    # for the weights and for the features
    assert sum(n * k * m for n, k, m in back.shapes) == 2 * rows * 24 * 7
    assert torch.isfinite(layer.weight.grad).all()


def test_frames_of_graphs_are_written_where_nodes_are(batch):
    import torch

    from nvsdata.models import Graph2GridLayer

    given = batch()
    with Products() as done:
        frames = Graph2GridLayer((4, 4), (64, 64))(given)
    assert done.added == [tuple(given.x.shape)]
    assert frames.shape == (2, 24, 1, 16, 16)
    assert torch.count_nonzero(frames.abs().sum(1)) == len(np.unique(given.pos[:NODES] // 4, axis=0)) * 2


def Products():
    """Sees the sizes (rows, inner, columns) of products of matrices, and the sizes of what is added to rows."""
    import torch
    from torch.utils._python_dispatch import TorchDispatchMode

    class Seen(TorchDispatchMode):
        def __init__(self):
            super().__init__()
            self.shapes, self.added = [], []

        def __torch_dispatch__(self, function, types, args=(), kwargs=None):
            packet = function.overloadpacket
            if packet in (torch.ops.aten.mm, torch.ops.aten.addmm, torch.ops.aten.addmm_, torch.ops.aten.bmm):
                a, b = args[-2:]
                self.shapes.append((*a.shape, b.shape[-1]))
            if packet in (torch.ops.aten.index_add, torch.ops.aten.index_add_):
                self.added.append(tuple(args[3].shape))
            return function(*args, **(kwargs or {}))

    return Seen()
