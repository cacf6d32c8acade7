"""Numbers through whole networks: precision, gradients, order."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from torch.autograd import gradcheck

from nvsdata import Events, GraphBatch, models
from nvsdata import transforms as T
from nvsdata.models import GraphPool


def graphs(count=4, nodes=300, size=(34, 34)):
    rng = np.random.default_rng(0)
    return [
        T.RadiusGraph()(
            Events(
                np.sort(rng.integers(0, 30_000, nodes)),
                rng.integers(0, size[0], nodes),
                rng.integers(0, size[1], nodes),
                rng.integers(0, 2, nodes),
                size,
            )
        )
        for _ in range(count)
    ]


def doubled(batch):
    return replace(batch, x=batch.x.double())


@pytest.mark.parametrize("training", [True, False])
@pytest.mark.parametrize("name", ["n-mnist", "asl-dvs"])
def test_float32_agrees_with_float64(name, training):
    batch = GraphBatch.from_graphs(graphs(size=models.CONFIGURATIONS[name]["sensor_size"]))
    model = models.rgcnn(name).train()
    model.dropout.p = 0.0
    model(batch)
    model.train(training)
    with torch.no_grad():
        single, double = model(batch), model.double()(doubled(batch))
    assert ((single - double).abs().max() / double.abs().max()).item() < 1e-4


def test_bfloat16_stays_near():
    """Autocast on the CPU: measured 0.3 to 0.5% of the largest score; bfloat16 has three digits."""
    batch = GraphBatch.from_graphs(graphs())
    model = models.rgcnn("n-mnist")
    model(batch)
    model.eval()
    with torch.no_grad():
        expected = model(batch)
        with torch.autocast("cpu", torch.bfloat16):
            scores = model(batch)
    assert ((scores - expected).abs().max() / expected.abs().max()).item() < 0.03


@pytest.mark.parametrize("mode", ["max", "average"])
def test_pooling_has_the_gradients_of_its_definition(mode):
    batch = GraphBatch.from_graphs(graphs(2, 20))
    pool = GraphPool((4, 4), (34, 34), mode)
    x = torch.randperm(40 * 3).double().view(40, 3).requires_grad_()
    assert gradcheck(lambda values: pool(replace(batch, x=values)).x, (x,))


@pytest.mark.parametrize("pooling", ["max", "average"])
@pytest.mark.parametrize("build", [models.RGCNN, models.GCNN])
def test_the_whole_network_has_the_gradients_of_its_definition(build, pooling):
    batch = doubled(GraphBatch.from_graphs(graphs(2, 15)))
    batch = replace(batch, x=torch.randn(30, 1, dtype=torch.float64))
    layers = {"channels": (3, 4), "clusters": ((4, 4), (17, 17)), "hidden": 5, "kernel_size": 3}
    model = build(3, **layers, dropout=0.0, pooling=pooling).double().eval()
    # away from the kinks of ReLU and maximum, which equal activations would be at
    for p in model.parameters():
        torch.nn.init.normal_(p, std=0.5)
    assert gradcheck(
        lambda values, *_: model(replace(batch, x=values)), (batch.x.requires_grad_(), *model.parameters())
    )


@pytest.mark.parametrize("build", [models.RGCNN, models.GCNN])
def test_the_order_of_edges_does_not_matter(build):
    batch = GraphBatch.from_graphs(graphs())
    order = torch.randperm(batch.num_edges)
    shuffled = replace(batch, edge_index=batch.edge_index[:, order], edge_attr=batch.edge_attr[order])
    model = build(10).eval()
    assert torch.allclose(model(batch), model(shuffled), atol=1e-5)
