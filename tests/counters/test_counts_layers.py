"""Layers of graph networks: they touch the nodes, edges and kernel cells that there are.

Run as a script by the fixture `counts`, without compiled kernels, so that arrays can count what is read and written.
"""

import json
from collections import Counter

import numpy as np
import pytest
from counting_work import flat, touches, uncompiled, watched

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


def planned(edges):
    """What the plan of a convolution takes, and its rows and entries."""
    from nvsdata.kernels import spline

    with touches(spline) as tally:
        starts, rows, entries, *_ = spline.spline_plan(*edges)
    return flat(tally) | {"rows": len(rows), "entries": len(entries), "cells": int((np.diff(starts) > 0).sum())}


def added(edges):
    from nvsdata.kernels import spline

    _, rows, into, of, share = spline.spline_plan(*edges)
    tally = Counter()
    out = watched(np.zeros((len(rows), CHANNELS), np.float32), "out", tally)
    features = watched(np.ones((NODES, CHANNELS), np.float32), "features", tally)
    spline.add_shares(out, into, features, of, share)
    return flat(tally)


def pooled(nodes, edges, grid, graphs=1):
    """What pooling takes: clusters, merged edges, and features."""
    from nvsdata.kernels import pool

    rng = np.random.default_rng(0)
    tally = Counter()
    # the same 16 x 16 clusters are occupied, however large the grid is
    pos = watched(rng.integers(0, 64, (nodes, 2)).astype(np.float32), "pos", tally)
    ptr = np.linspace(0, nodes, graphs + 1).astype(np.int64)
    with touches(pool) as found:
        cluster, position, *_ = pool.clusters(pos, np.zeros(nodes, np.int64), ptr, 4, 4, *grid)
    cluster, count = np.asarray(cluster), len(position)
    source, target = (watched(rng.integers(0, nodes, edges), name, tally) for name in ("source", "target"))
    with touches(pool) as merging:
        pool.merged_edges(source, target, cluster, count)
    x = watched(rng.random((nodes, CHANNELS)), "x", tally)
    with touches(pool) as largest:
        pool.max_rows(x, cluster, count)
    parts = {"clusters": found, "merged": merging, "largest": largest}
    return flat(tally) | {name: flat(part)["touched"] for name, part in parts.items()} | {"count": count}


def work():
    """All counts, by scenario."""
    return {
        "plan": planned(graph()),
        "plan with lonely nodes": planned(graph(10 * NODES)),
        "shares": added(graph()),
        "pooled": pooled(NODES, EDGES, (16, 16)),
        "pooled twice": pooled(2 * NODES, 2 * EDGES, (16, 16)),
        "pooled on a large sensor": pooled(NODES, EDGES, (100, 100)),
        "pooled on a large sensor, 4": pooled(NODES, EDGES, (100, 100), 4),
    }


@pytest.fixture(scope="module")
def counts():
    return uncompiled(__file__)


def test_a_plan_has_the_pairs_of_node_and_cell_that_edges_use(counts):
    found = pairs(*graph())
    assert counts["plan"]["entries"] == len(found)
    assert counts["plan"]["rows"] == len(set(found))
    assert counts["plan"]["cells"] == len({cell for _, cell in found})
    # of an edge's entries each is made, shared out, counted and put into its row; cells and nodes are counted
    assert counts["plan"]["touched"] <= 25 * 2**DIM * EDGES + 8 * SIZE**DIM + 8 * NODES


def test_lonely_nodes_cost_no_more_than_the_memory_of_their_degree(counts):
    without, lonely = counts["plan"], counts["plan with lonely nodes"]
    assert lonely["touched"] == without["touched"]
    assert lonely["spline made"] - without["spline made"] == 9 * NODES


def test_each_entry_adds_its_channels_once(counts):
    n = counts["plan"]["entries"] * CHANNELS
    assert counts["shares"] == {"features read": n, "out read": n, "out written": n, "touched": 3 * n}


def test_pooling_visits_each_node_and_edge_once(counts):
    for name, n, edges in (("pooled", NODES, EDGES), ("pooled twice", 2 * NODES, 2 * EDGES)):
        found = counts[name]
        # its cell, then its share of the mean; two numbers each time
        assert found["pos read"] == 4 * n
        # edges are counted and then put into order by their targets
        assert found["target read"] == 2 * edges
        assert found["source read"] == edges
        # a channel is compared with the largest so far, and taken if it is larger
        assert n * CHANNELS <= found["x read"] <= 2 * n * CHANNELS
        assert found["largest"] <= 6 * n * CHANNELS + 3 * n
        assert found["merged"] <= 12 * edges + 8 * found["count"]


def test_pooling_looks_twice_at_each_cell_of_a_graph_however_large_the_sensor(counts):
    nodes = counts["pooled"]["clusters"] - 2 * 16 * 16
    for name, graphs in (("pooled on a large sensor", 1), ("pooled on a large sensor, 4", 4)):
        assert counts[name]["clusters"] <= 2 * graphs * 100 * 100 + 1.2 * nodes


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

    from nvsdata.models import Graph2Grid

    given = batch()
    with Products() as done:
        frames = Graph2Grid((4, 4), (64, 64))(given)
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


if __name__ == "__main__":
    np.seterr(all="ignore")
    print(json.dumps(work()))
