"""Networks of graphs as torch.compile, torch.export and the meta device see them: without values."""

import copy
import io

import numpy as np
import pytest
import torch

import nvsdata
from nvsdata import GraphBatch, models
from nvsdata import transforms as T
from nvsdata.models import clusters, spline_sum

SMALL = {"channels": (4, 8), "clusters": ((4, 4), (7, 7)), "hidden": 8}


def graph(n, seed):
    rng = np.random.default_rng(seed)
    t, x, y, p = np.sort(rng.integers(0, 30_000, n)), *rng.integers(0, 34, (2, n)), rng.integers(0, 2, n)
    return T.RadiusGraph(3.0, max_degree=8)(nvsdata.Events(t, x, y, p, (34, 34)))


@pytest.fixture
def batches():
    """Two of other sizes."""
    return [GraphBatch.from_graphs([graph(90 + 7 * i, i) for i in range(many)]) for many in (3, 2)]


@pytest.fixture(autouse=True)
def _forget():
    torch._dynamo.reset()
    yield
    torch._dynamo.reset()


def double(batch):
    return batch._each(lambda tensor: tensor.double() if tensor.is_floating_point() and tensor.ndim == 2 else tensor)


@pytest.mark.parametrize(
    ("pooling", "sizes"),
    [("max", SMALL), ("average", {"channels": (4,), "clusters": ((7, 7),), "hidden": 8})],
    ids=["max", "average"],
)
def test_a_network_is_compiled_as_a_whole_and_learns_the_same(batches, pooling, sizes):
    ours = models.RGCNN(3, dropout=0.0, pooling=pooling, shortcut_start=0.5, **sizes).double()
    other = copy.deepcopy(ours)
    # no step of the forward pass is left to Python
    compiled = torch.compile(ours, backend="aot_eager", fullgraph=True, dynamic=True)
    for batch in batches:
        found, expected = compiled(batch), other(batch)
        torch.testing.assert_close(found, expected)
        found.square().sum().backward()
        expected.square().sum().backward()
    for a, b in zip(ours.parameters(), other.parameters(), strict=True):
        torch.testing.assert_close(a.grad, b.grad, atol=1e-9, rtol=1e-7)
    for a, b in zip(ours.buffers(), other.buffers(), strict=True):
        torch.testing.assert_close(a, b)


def test_a_network_is_exported_for_graphs_of_any_size_and_stored(batches):
    model = models.RGCNN(3, **SMALL).eval()
    given, other = batches
    sizes = torch.export.ShapesCollection()
    for name in ("x", "pos", "t", "edge_attr", "batch", "ptr"):
        sizes[getattr(given, name)] = {0: torch.export.Dim.DYNAMIC}
    sizes[given.edge_index] = {1: torch.export.Dim.DYNAMIC}
    program = torch.export.export(model, (given,), dynamic_shapes=sizes)
    file = io.BytesIO()
    torch.export.save(program, file)
    file.seek(0)
    for one in (program, torch.export.load(file)):
        for batch in batches:
            torch.testing.assert_close(one.module()(batch), model(batch))
    assert other.num_nodes != given.num_nodes


def test_the_meta_device_gives_shapes(batches):
    model = models.RGCNN(3, **SMALL).to("meta")
    scores = model.eval()(batches[0].to("meta"))
    assert scores.shape == (3, 3)
    assert scores.is_meta


def test_the_operators_are_what_torch_expects(batches):
    batch = double(batches[0])
    x = torch.randn(batch.num_nodes, 2, dtype=torch.float64, requires_grad=True)
    weight = torch.randn(25, 2, 3, dtype=torch.float64, requires_grad=True)
    u = batch.edge_attr
    torch.library.opcheck(spline_sum.summed, (x, batch.edge_index, u, weight, 5))
    torch.library.opcheck(spline_sum._looped, (batch.edge_index, u, batch.num_nodes, 0.0))
    pos = batches[0].pos
    given = pos, batch.t, batch.edge_index, u, batch.batch, batch.ptr, [4, 4], [9, 9]
    torch.library.opcheck(clusters._structure, given)
    cluster = clusters._structure(*given)[0]
    for mode in ("max", "average"):
        torch.library.opcheck(clusters._rows, (x, cluster, int(cluster.max()) + 1, mode))
