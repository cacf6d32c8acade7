from dataclasses import replace

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from strategies import events
from torch import nn

from nvsdata import Events, GraphBatch, collate, models
from nvsdata import transforms as T
from nvsdata.kernels.graph.spline import spline_plan
from nvsdata.models import GCNN, RGCNN, SplineConv, complexity

D240 = {"sensor_size": (240, 180), "hidden": 1024}


def graph(sensor_size=(240, 180)):
    """Five nodes; the first four in a chain of radius 3."""
    x = [10, 12, 14, 16, 30]
    return T.RadiusGraph()(Events([0, 100, 200, 300, 400], x, [20] * 5, [0, 1, 1, 0, 1], sensor_size))


# by the formulas; the table has 5.53 and 6.31 at depths 2 and 3, which would be those of 512 channels, not 256
@pytest.mark.parametrize(("depth", "size"), [(2, 4.54), (3, 5.31), (4, 18.81), (5, 43.81), (6, 68.81)])
def test_sizes_of_table_4_4(depth, size):
    model = GCNN(101, **models.DEPTHS[depth], **D240)
    assert len(models.DEPTHS[depth]["channels"]) == depth
    assert complexity(model, graph()).size == pytest.approx(size, abs=0.03)


@pytest.mark.parametrize(("kernel_size", "size"), [(2, 5.02), (3, 8.30), (4, 12.90), (5, 18.81), (6, 26.02)])
def test_sizes_of_table_4_5(kernel_size, size):
    model = GCNN(101, **models.DEPTHS[4], kernel_size=kernel_size, **D240)
    assert complexity(model, graph()).size == pytest.approx(size, abs=0.03)


def test_sizes_of_table_4_10():
    assert complexity(models.gcnn("n-caltech101"), graph()).size == pytest.approx(18.81, abs=0.03)
    assert complexity(models.rgcnn("n-caltech101"), graph()).size == pytest.approx(19.46, abs=0.03)


def test_graph_convolutions_follow_4_12():
    g = graph()
    edges, nodes = g.num_edges, g.num_nodes
    assert edges == 6
    first, *_ = complexity(GCNN(10, channels=(32,), clusters=((4, 4),), sensor_size=(240, 180)), g).layers
    assert first.flops == edges * 4 * (3 * 1 * 32 + 7 * 2) + (edges + nodes) * 32
    assert (first.name, first.parameters) == ("features.0.conv", (25 + 1) * 32)


def test_convolutions_and_full_layers_follow_4_11():
    model = nn.Sequential(nn.Conv2d(2, 8, 3, padding=1), nn.Flatten(), nn.Linear(8 * 30, 7))
    counted = complexity(model, torch.rand(1, 2, 5, 6))
    assert [layer.flops for layer in counted.layers] == [2 * 5 * 6 * (2 * 9 + 1) * 8, (2 * 240 - 1) * 7]
    assert [layer.parameters for layer in counted.layers] == [(2 * 9 + 1) * 8, 241 * 7]
    # as executed: no bias among the products
    assert counted.executed == 2 * 5 * 6 * 2 * 9 * 8 + 2 * 240 * 7
    volume = complexity(nn.Conv3d(2, 8, 3, stride=(1, 2, 2), padding=1), torch.rand(1, 2, 4, 6, 6))
    assert volume.flops == 2 * 4 * 3 * 3 * (2 * 27 + 1) * 8


class Lone(nn.Module):
    def __init__(self, before, after, size=5):
        super().__init__()
        self.conv = SplineConv(before, after, kernel_size=size)

    def forward(self, batch):
        return self.conv(batch.x, batch.edge_index, batch.edge_attr)


def test_what_is_executed_is_what_the_convolution_does():
    batch = GraphBatch.of(graph())
    # offsets of two pixels out of three: u = (1/2 ± 1/3, 1/2) lies between two of 5 cells along x, on one along y
    entries = 6 * 2
    bases = 6 * 2 * 3 + entries * 2
    assert complexity(Lone(1, 4), batch).executed == bases + 2 * entries + 2 * 5 * 25 * 4
    batch = replace(batch, x=torch.rand(5, 16))
    # with many channels, only (node, cell) pairs that occur: 2 for each side on which a node has a neighbor; each
    # pair's product is added
    rows = 2 + 4 + 4 + 2
    assert complexity(Lone(16, 4), batch).executed == bases + 2 * entries * 16 + 2 * rows * 16 * 4 + rows * 4
    # a kernel of one cell: a quotient for each edge, no shares
    batch = replace(batch, x=torch.rand(5, 3))
    single = complexity(Lone(3, 4, 1), batch)
    assert single.executed == 6 * 2 + 2 * 6 * 3 + 2 * 5 * 3 * 4
    assert (single.layers[0].parameters, single.layers[0].weights) == ((3 + 1) * 4, (3 + 1) * 4)


@given(events(max_size=40, width=20, height=20), st.integers(1, 6), st.sampled_from([1, 6, 40]))
def test_shares_are_those_that_the_kernels_find(ev, size, channels):
    batch = GraphBatch.of(T.RadiusGraph()(ev))
    if not batch.num_edges:
        return
    batch = replace(batch, x=torch.rand(batch.num_nodes, channels))
    arrays = batch.edge_index[0].numpy(), batch.edge_index[1].numpy(), batch.edge_attr.numpy()
    cells = size**2
    _, rows, entries, *_ = map(len, spline_plan(*arrays, size, batch.num_nodes))
    edges, nodes = batch.num_edges, batch.num_nodes
    expected = edges * 6 * (size > 1) + entries * 2 + 2 * entries * channels
    if size == 1 or cells * channels <= 128:
        expected += 2 * nodes * cells * channels * 4
    else:
        expected += 2 * rows * channels * 4 + rows * 4
    assert complexity(Lone(channels, 4, size), batch).executed == expected


def test_a_graph_network_adds_up():
    """A convolution, its normalization, the pooling of an average, and two full layers, by hand."""
    clusters = {"channels": (32,), "clusters": ((60, 45),), "sensor_size": (240, 180)}
    model = GCNN(10, **clusters, hidden=7, pooling="average")
    counted = complexity(model, graph())
    layers = {layer.name: layer for layer in counted.layers}
    assert list(layers) == ["features.0.conv", "features.0.norm", "features.2", "hidden", "classify", ""]
    # 6 edges of two cells, and 5 loops in the middle of the kernel; the root's product, and all 25 cells of each node
    shares = 11 * 6 + (12 + 5) * 2 + 2 * (12 + 5)
    assert layers["features.0.conv"].executed == shares + 2 * 5 * 1 * 32 + 2 * 5 * 25 * 32
    assert layers["features.0.norm"].executed == 2 * 5 * 32
    # one cluster: its position, its average; no edge is left
    assert layers["features.2"].executed == 2 * (5 + 1) + (5 + 1) * 32
    assert (layers["features.2"].flops, layers["features.2"].weights) == (None, 0)
    # in which cell the pooled node lies
    assert layers[""].executed == 2
    # 4 x 4 cells of 32 channels
    assert layers["hidden"].executed == 2 * 512 * 7
    assert layers["hidden"].flops == (2 * 512 - 1) * 7
    assert (layers["hidden"].parameters, layers["hidden"].weights) == ((32 + 1) * 7, (512 + 1) * 7)
    assert counted.executed == sum(layer.executed for layer in counted.layers)
    assert counted.weights == sum(layer.weights for layer in counted.layers)
    assert counted.uncounted == ()


def test_sequences_of_graphs_and_their_grids_are_counted():
    sequence = collate([([graph((34, 34))] * 4, 0)]).inputs
    model = models.RGCNN3D(3, temporal="plain", sensor_size=(34, 34), channels=(4,), clusters=((8, 8),))
    counted = complexity(model, sequence)
    layers = {layer.name: layer for layer in counted.layers}
    # five by five cells, four graphs
    assert layers["temporal.0.0"].executed == 2 * 4 * 5 * 5 * 4 * 27 * 128
    assert layers["temporal.0.1"].executed == 2 * 4 * 5 * 5 * 128
    # the mean over what is left of the map is the network's own
    maps = model.eval().features(sequence)
    assert layers[""].executed == maps.numel() + 512
    assert counted.uncounted == ()


def by_hand():
    """Layers of torch, an input, and the operations of each, counted by hand: a multiply-add is two."""
    yield nn.Linear(5, 3), (2, 7, 5), 14 * 2 * 5 * 3
    yield nn.Linear(5, 3, bias=False), (2, 5), 2 * 2 * 5 * 3
    yield nn.Conv1d(4, 6, 3), (2, 4, 10), 2 * 8 * 2 * 4 * 3 * 6
    yield nn.Conv2d(4, 6, 3, groups=2, stride=2), (1, 4, 9, 7), 4 * 3 * 2 * 2 * 9 * 6
    yield nn.Conv3d(2, 3, (1, 3, 3)), (1, 2, 4, 5, 5), 4 * 3 * 3 * 2 * 2 * 9 * 3
    yield nn.BatchNorm2d(3), (2, 3, 4, 5), 2 * 2 * 3 * 4 * 5
    yield nn.BatchNorm1d(3, track_running_stats=False), (8, 3), 6 * 8 * 3
    yield models.BatchNorm(3), (8, 3), 2 * 8 * 3
    yield nn.ReLU(), (4, 4), 0
    yield nn.MaxPool2d(2), (1, 2, 4, 4), 0
    yield nn.Dropout(), (4, 4), 0
    yield nn.Flatten(), (4, 4, 2), 0
    yield nn.PReLU(), (4, 4), 16
    yield nn.Sigmoid(), (4, 4), 16
    yield nn.AvgPool2d(2), (1, 2, 4, 6), 2 * 2 * 3 * (4 + 1)
    yield nn.AdaptiveAvgPool2d(2), (1, 2, 4, 6), 2 * (24 + 4)
    # windows of 5 rows into 2: two of three, which share one
    yield nn.AdaptiveAvgPool2d((2, 1)), (1, 1, 5, 4), 6 * 4 + 2
    yield nn.LSTM(4, 6, 2), (10, 1, 4), 10 * (2 * 24 * (4 + 6) + 2 * 24 * (6 + 6) + 9 * 12)
    yield nn.LSTM(4, 6, bidirectional=True, batch_first=True), (3, 10, 4), 30 * 2 * (2 * 24 * (4 + 6) + 9 * 6)
    yield nn.GRU(4, 6), (10, 2, 4), 20 * (2 * 18 * (4 + 6) + 8 * 6)


@pytest.mark.parametrize("kind", [torch.float32, torch.float64])
@pytest.mark.parametrize(("module", "shape", "operations"), list(by_hand()))
def test_layers_of_torch_by_hand(module, shape, operations, kind):
    counted = complexity(module.to(kind), torch.rand(shape, dtype=kind))
    assert counted.executed == operations
    assert counted.uncounted == ()


class Whole(nn.Module):
    """Operations that no layer does."""

    def __init__(self):
        super().__init__()
        self.table = nn.Parameter(torch.rand(3, 4))

    def forward(self, x):
        together = torch.einsum("bi,ij->bj", x, self.table) + x.sum()
        return (together * together).argmax(1), torch.arange(3) * 7


def test_what_no_layer_does_is_the_networks_own():
    counted = complexity(Whole(), torch.rand(5, 3))
    (own,) = counted.layers
    assert (own.name, own.kind, own.flops, own.parameters, own.weights) == ("", "Whole", None, None, 12)
    assert own.executed == 2 * 5 * 3 * 4 + 15 + 20 + 20
    with torch.inference_mode():
        assert complexity(Whole(), torch.rand(5, 3)).executed == own.executed


class Elsewhere(nn.Module):
    def forward(self, x):
        return torch.from_numpy(x.numpy() ** 2)


def test_what_cannot_be_counted_is_named():
    model = nn.Sequential(nn.Linear(4, 4), nn.LayerNorm(4), Elsewhere(), nn.Identity(), nn.Flatten())
    counted = complexity(model, torch.rand(2, 4))
    assert counted.uncounted == ("1 (LayerNorm): aten.native_layer_norm", "2 (Elsewhere): computation outside torch")
    assert "not counted: 2 (Elsewhere)" in str(counted)
    assert counted.executed == 2 * 2 * 4 * 4


def test_a_layer_that_runs_twice_counts_twice():
    linear = nn.Linear(4, 4)
    counted = complexity(nn.Sequential(linear, nn.ReLU(), linear), torch.rand(1, 4))
    assert (counted.flops, counted.executed) == (2 * 7 * 4, 2 * 2 * 16)
    assert counted.weights == sum(layer.weights for layer in counted.layers) == 20


def test_the_model_is_left_as_it_was():
    model = models.rgcnn("n-mnist").train()
    model.features[0].norm.eval()
    before = {name: value.clone() for name, value in model.state_dict().items()}
    counted = complexity(model, graph((34, 34)))
    assert model.training
    assert [m for m in model.modules() if not m.training] == [model.features[0].norm]
    assert not any(m._forward_hooks for m in model.modules())
    assert all(torch.equal(value, before[name]) for name, value in model.state_dict().items())
    assert counted.weights == sum(p.numel() for p in model.parameters())
    assert "executed" in str(counted)


@pytest.mark.parametrize("convolution", ["spline", *models.CONVOLUTIONS])
def test_graph_networks_are_counted_completely(convolution):
    counted = complexity(models.gcnn("n-mnist", convolution=convolution), graph((34, 34)))
    assert counted.uncounted == ()
    assert all(layer.executed > 0 for layer in counted.layers)


def test_layers_without_a_formula_have_none():
    counted = complexity(models.gcnn("n-mnist", convolution="gcn"), graph((34, 34)))
    first = counted.layers[0]
    assert (first.kind, first.flops, first.parameters, first.weights) == ("GCNConv", None, None, 64)
    # a product; degrees and roots of 5 nodes; scaled before and after, 6 sums, the bias
    assert first.executed == 2 * 5 * 32 + 5 * 2 + (5 + 6 + 5 + 5) * 32
    assert counted.flops == sum(layer.flops for layer in counted.layers if layer.kind == "Linear")


def test_residual_networks_have_a_shortcut_a_block():
    layers = complexity(RGCNN(3), graph((34, 34))).layers
    kinds = [layer.name.rsplit(".", 1)[-1] for layer in layers if layer.flops is not None]
    assert kinds == ["conv", "conv", "shortcut", "conv", "shortcut", "hidden", "classify"]
