from copy import deepcopy
from functools import cache

import pytest
import torch
from graphs import scattered
from torch.nn.functional import cross_entropy

from nvsdata import GraphBatch, models
from nvsdata.models.spline import SplineConv
from nvsdata.models.spline_sum import spline_sum_torch


@cache
def batch():
    return GraphBatch.from_graphs([scattered(300, seed) for seed in range(8)])


def network(pooling="max"):
    """A network that has seen a few batches."""
    torch.manual_seed(0)
    model = models.rgcnn("n-mnist", pooling=pooling)
    model.dropout.p = 0.0
    with torch.no_grad():
        for _ in range(3):
            model(batch())
    return model.eval()


# bfloat16 has 8 bits, float16 11
@pytest.mark.parametrize(("dtype", "error"), [(torch.bfloat16, 0.05), (torch.float16, 0.005), (torch.float64, 1e-5)])
@pytest.mark.parametrize("pooling", ["max", "average"])
def test_a_network_of_another_precision_scores_nearly_the_same(dtype, error, pooling):
    model = network(pooling)
    expected = model(batch())
    scores = deepcopy(model).to(dtype)(batch())
    assert scores.dtype == dtype
    assert (scores.float() - expected).abs().max() < error * expected.abs().max()


@pytest.mark.parametrize("dtype", [torch.bfloat16, torch.float16])
def test_half_precision_can_be_trained(dtype):
    model = network()
    targets = torch.arange(8)
    kinds = {}
    for kind in (torch.float32, dtype):
        one = deepcopy(model).to(kind).train()
        cross_entropy(one(batch()).float(), targets).backward()
        kinds[kind] = torch.cat([p.grad.flatten().float() for p in one.parameters()])
    assert kinds[dtype].isfinite().all()
    assert torch.cosine_similarity(kinds[torch.float32], kinds[dtype], 0) > 0.9


@pytest.mark.parametrize("dtype", [torch.bfloat16, torch.float16])
def test_many_neighbors_are_counted_and_summed_in_single_precision(dtype):
    conv = SplineConv(1, 1, kernel_size=1, bias=False).to(dtype)
    torch.nn.init.ones_(conv.weight)
    nodes = 1_001
    edges = torch.stack((torch.arange(1, nodes), torch.zeros(nodes - 1, dtype=torch.int64)))
    out = conv(torch.ones(nodes, 1, dtype=dtype), edges, torch.full((nodes - 1, 2), 0.5))
    assert out[0].item() == pytest.approx(1, rel=0.01)


@pytest.mark.parametrize("kernel_size", [1, 5])
@pytest.mark.parametrize("channels", [2, 40])
def test_a_second_derivative_is_refused(kernel_size, channels):
    conv = SplineConv(channels, 2, kernel_size=kernel_size).double()
    x = torch.randn(4, channels, dtype=torch.float64, requires_grad=True)
    edges, u = torch.tensor([[0, 1, 2], [1, 2, 3]]), torch.rand(3, 2, dtype=torch.float64)
    (first,) = torch.autograd.grad(conv(x, edges, u).square().sum(), x, create_graph=True)
    with pytest.raises(RuntimeError, match="differentiate twice"):
        first.sum().backward()


def test_torch_has_a_second_derivative():
    x = torch.randn(4, 2, dtype=torch.float64, requires_grad=True)
    edges, u = torch.tensor([[0, 1, 2], [1, 2, 3]]), torch.rand(3, 2, dtype=torch.float64)
    weight = torch.randn(25, 2, 3, dtype=torch.float64)

    def convolved(x):
        return spline_sum_torch(x.new_zeros(4, 3), x, edges, u, weight, 5)

    assert torch.autograd.gradgradcheck(convolved, (x,))
