"""PyTorch Geometric's graphs in nvsdata, and nvsdata's in PyTorch Geometric."""

import subprocess
import sys
from dataclasses import replace

import pytest
import torch
from graphs import same
from graphs import scattered as graph
from hypothesis import given
from hypothesis import strategies as st

from nvsdata import Graph, GraphBatch, models
from nvsdata.data.pseudo import pseudo


@pytest.fixture(scope="module", autouse=True)
def _pyg():
    # not while tests are collected: every process does that, and it takes seconds
    global pyg
    pyg = pytest.importorskip("torch_geometric.data")


def conventional(g, **more):
    """As PyTorch Geometric's own transforms make them: edges in any order, no times, no settings."""
    order = torch.randperm(g.num_edges, generator=torch.Generator().manual_seed(0))
    return pyg.Data(x=g.x, pos=g.pos, edge_index=g.edge_index[:, order], **more)


@given(st.integers(0, 20), st.sampled_from([None, 3]), st.floats(1, 9))
def test_a_graph_there_and_back_keeps_every_field(n, y, radius):
    g = graph(n, radius=radius, y=y)
    data = g.to_pyg()
    assert type(data) is pyg.Data
    assert data.num_nodes == n
    same(Graph.from_pyg(data), g)


@given(st.lists(st.integers(0, 12), min_size=1, max_size=6), st.booleans(), st.integers(1, 3))
def test_a_batch_there_and_back_keeps_every_field(sizes, labeled, volumes):
    graphs = [graph(n, i, y=i if labeled else None) for i, n in enumerate(sizes)]
    batch = GraphBatch.from_graphs(graphs, volumes=volumes)
    theirs = batch.to_pyg()
    assert isinstance(theirs, pyg.Batch)
    assert theirs.num_graphs == len(graphs)
    same(GraphBatch.from_pyg(theirs), batch)
    for ours, data in zip(graphs, theirs.to_data_list(), strict=True):
        back = Graph.from_pyg(data)
        assert back.y is None if ours.y is None else back.y.tolist() == [ours.y]
        same(replace(back, y=ours.y), ours)


@pytest.mark.parametrize("dtype", [torch.int32, torch.float64])
def test_the_type_of_labels_stays(dtype):
    batch = GraphBatch.from_graphs([graph(y=1), graph(y=2)])
    batch = replace(batch, y=batch.y.to(dtype) + 0.1 if dtype.is_floating_point else batch.y.to(dtype))
    same(GraphBatch.from_pyg(batch.to_pyg()), batch)


def test_a_batch_that_pytorch_geometric_made_of_our_graphs():
    graphs = [graph(9, 1, y=4), graph(0, 2, y=5), graph(30, 3, y=6), graph(0, 4, y=7)]
    theirs = pyg.Batch.from_data_list([g.to_pyg() for g in graphs])
    same(GraphBatch.from_pyg(theirs), GraphBatch.from_graphs(graphs))


def test_what_is_missing_is_computed():
    g = graph(60)
    found = Graph.from_pyg(conventional(g))
    assert found.t.tolist() == [0] * 60
    assert (found.edge_index[1].diff() >= 0).all()
    assert sorted(found.edge_index.T.tolist()) == sorted(g.edge_index.T.tolist())
    assert found.pseudo == "signed"
    assert torch.equal(found.edge_attr, pseudo(g.pos, found.t, found.edge_index, (3.0, 3.0), "signed"))
    wider = Graph.from_pyg(conventional(g, reach=(6.0, 6.0)))
    assert torch.allclose((wider.edge_attr - 0.5) * 2, found.edge_attr - 0.5, atol=1e-6)
    absolute = Graph.from_pyg(conventional(g, pseudo="abs"))
    assert torch.equal(absolute.edge_attr, pseudo(g.pos, found.t, found.edge_index, (3.0, 3.0), "abs"))
    with pytest.raises(ValueError, match="pseudo must be one of"):
        Graph.from_pyg(conventional(g, pseudo="foo"))
    reach = (3.0, 3.0, 100.0)
    timed = Graph.from_pyg(conventional(g, pseudo="signed-time", reach=reach, t=g.t))
    assert torch.equal(timed.edge_attr, pseudo(g.pos, g.t, found.edge_index, reach, "signed-time"))


def test_edge_attributes_follow_their_edges():
    g = graph(60)
    order = torch.randperm(g.num_edges)
    data = pyg.Data(x=g.x, pos=g.pos, edge_index=g.edge_index[:, order], edge_attr=g.edge_attr[order])
    found = Graph.from_pyg(data)
    assert torch.equal(found.edge_attr, pseudo(g.pos, g.t, found.edge_index, g.reach, g.pseudo))


NETWORKS = {
    "rgcnn": lambda: models.rgcnn("n-mnist"),
    "gcnn": lambda: models.gcnn("n-mnist", convolution="gin"),
    "rgcnn3d": lambda: models.RGCNN3D(3, sensor_size=(34, 34), channels=(8, 8), clusters=((2, 2), (4, 4))),
    "fused": lambda: models.fused(models.rgcnn("n-mnist")),
    "grid": lambda: models.Graph2GridLayer((2, 2), (34, 34)),
}


@pytest.mark.parametrize("name", NETWORKS)
def test_every_network_of_graphs_takes_them(name):
    torch.manual_seed(0)
    model = NETWORKS[name]().eval()
    graphs = [graph(80, i) for i in range(4)]
    ours = GraphBatch.from_graphs(graphs, volumes=4 if name == "rgcnn3d" else 1)
    # sums over edges in another order
    close = {"rtol": 1e-5, "atol": 1e-6}
    torch.testing.assert_close(model(ours.to_pyg()), model(ours), rtol=0, atol=0)
    if name != "rgcnn3d":
        # one graph is no sequence
        torch.testing.assert_close(model(graphs[0].to_pyg()), model(graphs[0]), rtol=0, atol=0)
        torch.testing.assert_close(model(conventional(graphs[0], pseudo="signed")), model(graphs[0]), **close)
    theirs = pyg.Batch.from_data_list([conventional(g, pseudo="signed") for g in graphs])
    theirs.volumes = ours.volumes
    torch.testing.assert_close(model(theirs), model(ours), **close)


def test_batches_without_ptr_and_graphs_in_a_batch_of_one():
    batch = GraphBatch.from_graphs([graph(9), graph(4)])
    data = pyg.Data(**{name: getattr(batch, name) for name in ("x", "pos", "edge_index", "batch")})
    assert GraphBatch.from_pyg(data).ptr.tolist() == [0, 9, 13]
    one = GraphBatch.from_pyg(graph(9, y=3).to_pyg())
    same(one, GraphBatch.of(graph(9, y=3)))


WRONG = {
    "no pos": ({"pos": None}, "a graph needs x, pos, edge_index; this Data has no pos"),
    "no pos and edges": ({"pos": None, "edge_index": None}, "has no pos and edge_index"),
    "three coordinates": (
        {"pos": torch.zeros(5, 3)},
        r"x and pos must be .*belong in t.* \[5, 1\] and \[5, 3\]",
    ),
    "flat features": ({"x": torch.zeros(5)}, "x and pos must be"),
    "seconds": ({"t": torch.zeros(5)}, r"t must be whole µs, \[5\], not torch.float32"),
    "edges turned": ({"edge_index": torch.zeros(7, 2, dtype=torch.int64)}, r"edge_index must be int64 \[2, E\]"),
    "no such node": ({"edge_index": torch.tensor([[0], [5]])}, "names nodes from 0 to 5; there are 5"),
    "distances": ({"edge_attr": torch.zeros(3, 1)}, r"pseudo-coordinates \[3, 2\], not \[3, 1\]; remove edge_attr"),
    "tensor of reach": ({"reach": torch.ones(2)}, "reach must be numbers or strings, not a tensor"),
    "no x": ({"x": None}, "this Data has no x$"),
    "more positions than nodes": ({"pos": torch.zeros(6, 2)}, r"not \[5, 1\] and \[6, 2\]$"),
    "fewer positions than nodes": ({"pos": torch.zeros(4, 2)}, r"not \[5, 1\] and \[4, 2\]$"),
    "a time too few": ({"t": torch.zeros(4, dtype=torch.int64)}, r"t must be whole µs, \[5\], not torch.int64 \[4\]$"),
    "edges in pixels": ({"edge_index": torch.zeros(2, 3)}, r"edge_index must be .*, not torch.float32 \[2, 3\]$"),
    "edges in a row": ({"edge_index": torch.zeros(2, dtype=torch.int64)}, r"not torch.int64 \[2\]$"),
    "a node before the first": ({"edge_index": torch.tensor([[-1], [0]])}, "names nodes from -1 to 0; there are 5"),
    "attributes of fewer edges": ({"edge_attr": torch.zeros(2, 2)}, r"pseudo-coordinates \[3, 2\], not \[2, 2\]"),
    "attributes without time": (
        {"edge_attr": torch.zeros(3, 2), "reach": (3.0, 3.0, 9.0)},
        r"pseudo-coordinates \[3, 3\], not \[3, 2\]",
    ),
    "several graphs": ({"batch": torch.zeros(5, dtype=torch.int64)}, "use GraphBatch.from_pyg"),
}


@pytest.mark.parametrize("name", WRONG)
def test_what_is_wrong_is_named(name):
    change, message = WRONG[name]
    right = {"x": torch.zeros(5, 1), "pos": torch.zeros(5, 2), "edge_index": torch.zeros(2, 3, dtype=torch.int64)}
    with pytest.raises(ValueError, match=message):
        Graph.from_pyg(pyg.Data(**right | change))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"batch": [1, 0, 0, 0, 0]}, "batch must be the numbers"),
        ({"batch": [0, 0]}, r"batch must be the numbers of the nodes' graphs in ascending order, \[5\]$"),
        ({"batch": [-1, 0, 0, 0, 1]}, "batch must be the numbers"),
        ({"pseudo": ["abs", "signed"]}, r"graphs of different pseudo in one batch: \['abs', 'signed'\]$"),
        ({"batch": [0, 0, 0, 1, 1]}, "edges from one graph to another"),
        ({"reach": [(3.0, 3.0), (4.0, 4.0)]}, "graphs of different reach in one batch"),
    ],
)
def test_batches_that_contradict_themselves(change, message):
    values = {"batch": [0, 0, 0, 0, 1], **change}
    data = pyg.Data(x=torch.zeros(5, 1), pos=torch.zeros(5, 2), edge_index=torch.tensor([[0, 3], [1, 2]]))
    data.batch = torch.tensor(values.pop("batch"))
    data.update(values)
    with pytest.raises(ValueError, match=message):
        GraphBatch.from_pyg(data)


def test_fields_of_other_types_become_those_of_graphs():
    data = pyg.Data(
        x=torch.tensor([[1], [2], [3]]),
        pos=torch.tensor([[0, 0], [1, 1], [2, 2]], dtype=torch.float64),
        t=torch.tensor([5, 6, 7], dtype=torch.int32),
        edge_index=torch.tensor([[2, 0], [1, 0]], dtype=torch.int32),
        edge_attr=torch.tensor([[1, 2, 3], [4, 5, 6]]),
        reach=[3.0, 3.0, 9.0],
        sensor_size=[4, 5],
    )
    found = Graph.from_pyg(data)
    assert (found.x.dtype, found.pos.dtype, found.t.dtype) == (torch.float32, torch.float32, torch.int64)
    assert found.edge_index.tolist() == [[0, 2], [0, 1]]
    assert found.edge_index.dtype == torch.int64
    assert found.edge_attr.tolist() == [[4, 5, 6], [1, 2, 3]]
    assert found.edge_attr.dtype == torch.float32
    # with a third axis, there is time
    assert (found.reach, found.sensor_size, found.pseudo) == ((3.0, 3.0, 9.0), (4, 5), "signed-time")
    assert Graph.from_pyg(pyg.Data(x=data.x.double(), pos=data.pos, edge_index=data.edge_index)).x.dtype == torch.double


def test_edges_in_order_stay_as_they_are():
    edges = torch.tensor([[1, 0, 2], [0, 0, 1]])
    data = pyg.Data(x=torch.zeros(3, 1), pos=torch.zeros(3, 2), edge_index=edges, edge_attr=torch.zeros(3, 2))
    assert Graph.from_pyg(data).edge_index.data_ptr() == edges.data_ptr()
    data.edge_index = torch.zeros(2, 0, dtype=torch.int64)
    data.edge_attr = torch.zeros(0, 2)
    assert Graph.from_pyg(data).num_edges == 0


def test_a_batch_is_as_large_as_its_largest_graph():
    graphs = [replace(graph(3), sensor_size=size, y=float(n)) for n, size in enumerate(((9, 3), (4, 7)))]
    theirs = pyg.Batch.from_data_list([g.to_pyg() for g in graphs])
    assert GraphBatch.from_pyg(theirs).sensor_size == (9, 7)
    assert GraphBatch.from_pyg(theirs).y.tolist() == [0, 1]
    one = GraphBatch.from_pyg(graph(4, y=torch.tensor([[1, 2]])).to_pyg())
    assert one.y.tolist() == [[1, 2]]
    assert GraphBatch.from_pyg(graph(4).to_pyg()).y is None
    assert (one.ptr.tolist(), one.batch.tolist()) == ([0, 4], [0] * 4)
    # graphs without nodes at the end are known by their number only
    last = pyg.Batch.from_data_list([graph(4).to_pyg(), graph(0).to_pyg()])
    assert GraphBatch.from_pyg(last).ptr.tolist() == [0, 4, 4]


def test_networks_do_not_import_it():
    code = (
        "import sys, numpy as np; from nvsdata import Events, models, transforms as T;"
        "models.rgcnn('n-mnist').eval()(T.RadiusGraph()(Events([1, 2], [1, 2], [1, 2], [0, 1], (34, 34))));"
        "sys.exit('torch_geometric' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], timeout=120).returncode == 0
