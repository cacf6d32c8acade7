from dataclasses import replace

import pytest
import torch
from torch import nn

from nvsdata import Events, GraphBatch, models
from nvsdata import transforms as T
from nvsdata.models import GCNN, RGCNN, SplineConv, complexity

D240 = {"sensor_size": (240, 180), "hidden": 1024}


def graph(sensor_size=(240, 180)):
    """Five nodes; the first four in a chain of radius 3."""
    x = [10, 12, 14, 16, 30]
    return T.radius_graph(Events([0, 100, 200, 300, 400], x, [20] * 5, [0, 1, 1, 0, 1], sensor_size))


@pytest.mark.parametrize(("depth", "size"), [(2, 5.53), (3, 6.31), (4, 18.81), (5, 43.81), (6, 68.81)])
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
    def __init__(self, *arguments):
        super().__init__()
        self.conv = SplineConv(*arguments)

    def forward(self, batch):
        return self.conv(batch.x, batch.edge_index, batch.edge_attr)


def test_what_is_executed_is_what_the_convolution_does():
    batch = GraphBatch.of(graph())
    # offsets of two pixels out of three: u = (2/3, 0) lies between the cells 2 and 3 of 5 along x
    entries = 6 * 2
    assert complexity(Lone(1, 4), batch).executed == 2 * entries + 2 * 5 * 25 * 4
    batch = replace(batch, x=torch.rand(5, 16))
    # with many channels, only (node, cell) pairs that occur: 2 a node that has neighbors
    assert complexity(Lone(16, 4), batch).executed == 2 * entries * 16 + 2 * (4 * 2) * 16 * 4


def test_the_model_is_left_as_it_was():
    model = models.rgcnn("n-mnist").train()
    before = {name: value.clone() for name, value in model.state_dict().items()}
    counted = complexity(model, graph((34, 34)))
    assert model.training
    assert not any(m._forward_hooks for m in model.modules())
    assert all(torch.equal(value, before[name]) for name, value in model.state_dict().items())
    assert counted.weights == sum(p.numel() for p in model.parameters())
    assert "executed" in str(counted)


def test_layers_without_a_formula_count_as_they_are():
    counted = complexity(models.gcnn("n-mnist", convolution="gcn"), graph((34, 34)))
    assert counted.flops > 0
    assert counted.layers[0].parameters == 64
    lstm = complexity(models.reference.LSTM(3, hidden=8, layers=1), torch.rand(1, 10, 4))
    assert lstm.layers[0].flops == 10 * 2 * 32 * (4 + 8)


def test_residual_networks_have_a_shortcut_a_block():
    kinds = [layer.name.rsplit(".", 1)[-1] for layer in complexity(RGCNN(3), graph((34, 34))).layers]
    assert kinds == ["conv", "conv", "shortcut", "conv", "shortcut", "hidden", "classify"]
