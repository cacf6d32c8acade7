import numpy as np
import pytest
import torch
from graphs import scattered

from nvsdata import GraphBatch, models
from nvsdata.kernels.graph.edges import with_self_loops
from nvsdata.models.spline_sum import spline_sum, spline_sum_torch

pytest.importorskip("triton.language")

from nvsdata.kernels.triton import spline as kernel
from nvsdata.models.spline_classes import class_sum

TOLERANCES = {torch.float32: {"rtol": 2e-5, "atol": 2e-5}, torch.float64: {"rtol": 1e-12, "atol": 1e-12}}


def inputs(nodes, channels, outputs, dtype):
    generator = torch.Generator().manual_seed(nodes)
    x = torch.randn(nodes, channels, dtype=dtype, generator=generator)
    weight = torch.randn(25, channels, outputs, dtype=dtype, generator=generator)
    return torch.randn(nodes, outputs, dtype=dtype, generator=generator), x, weight


def results(add, graph, given, device="cpu"):
    """The sums of a B-spline convolution, and the gradients of features and weights."""
    out, x, weight = (tensor.to(device) for tensor in given)
    x.requires_grad_()
    weight.requires_grad_()
    edges, u = graph.edge_index.to(device), graph.edge_attr.to(device)
    sums = add(out.clone(), x, edges, u, weight, 5)
    assert sums is not None
    gradients = torch.autograd.grad(sums.sin().sum(), (x, weight))
    return [tensor.detach().cpu() for tensor in (sums, *gradients)]


@pytest.mark.parametrize("dtype", TOLERANCES, ids=str)
@pytest.mark.parametrize("sizes", [(1, 8), (3, 33), (40, 5)], ids=str)
def test_sums_and_gradients_are_those_of_the_cpu(sizes, dtype, device):
    graph, given = scattered(60, radius=4.0), inputs(60, *sizes, dtype)
    for found, expected in zip(
        results(class_sum, graph, given, device), results(spline_sum, graph, given), strict=True
    ):
        torch.testing.assert_close(found, expected, **TOLERANCES[dtype])


def test_edges_needn_t_be_sorted(device):
    graph, given = scattered(80, radius=4.0), inputs(80, 3, 5, torch.float64)
    order = torch.randperm(graph.num_edges)
    expected = results(spline_sum, graph, given)
    graph.edge_index[:], graph.edge_attr[:] = graph.edge_index[:, order], graph.edge_attr[order]
    for found, wanted in zip(results(class_sum, graph, given, device), expected, strict=True):
        torch.testing.assert_close(found, wanted, **TOLERANCES[torch.float64])


@pytest.mark.parametrize("edges", [63, 64, 65, 2048, 5000])
def test_classes_of_more_edges_than_a_program_adds(edges, device):
    random = np.random.default_rng(edges)
    target = np.sort(random.integers(0, 7, edges))
    u = random.choice([0.0, 0.25, 1.0], p=[0.9, 0.09, 0.01], size=(edges, 2)).astype(np.float32)
    arrays = with_self_loops(random.integers(0, 7, edges), target, u, 7, 0.5)
    graph = scattered(7)
    object.__setattr__(graph, "edge_index", torch.from_numpy(arrays[0]))
    object.__setattr__(graph, "edge_attr", torch.from_numpy(arrays[1]))
    given = inputs(7, 2, 3, torch.float64)
    for found, wanted in zip(results(class_sum, graph, given, device), results(spline_sum, graph, given), strict=True):
        torch.testing.assert_close(found, wanted, **TOLERANCES[torch.float64])


def test_gradients_are_right(device):
    graph = scattered(4, radius=40.0)
    out, x, weight = (tensor.to(device).requires_grad_() for tensor in inputs(4, 2, 3, torch.float64))
    edges, u = graph.edge_index.to(device), graph.edge_attr.to(device)
    # sums of atomic additions differ in the last bits
    way = {"nondet_tol": 1e-12, "fast_mode": True}
    torch.autograd.gradcheck(
        lambda *given: class_sum(given[0].clone(), given[1], edges, u, given[2], 5), (out, x, weight), **way
    )


def test_classes_are_the_offsets_of_pixels(device):
    graph = scattered(400)
    classes = kernel.offset_classes(graph.edge_index.to(device), graph.edge_attr.to(device), 400)
    pixels = torch.unique(((classes.u.cpu() - 0.5) * 6).round(), dim=0)
    assert len(pixels) == len(classes.u) <= 29
    assert torch.equal(classes.start.cpu()[[0, -1]], torch.tensor([0, graph.num_edges]))
    lengths = classes.start.diff().cpu()
    assert (lengths > 0).all()
    expected = set(zip(*graph.edge_index.tolist(), map(tuple, graph.edge_attr.tolist()), strict=True))
    u = classes.u.cpu().repeat_interleave(lengths, 0)
    found = zip(classes.source.tolist(), classes.target.tolist(), map(tuple, u.tolist()), strict=True)
    assert set(found) == expected


def test_what_is_nan_comes_out_as_nan(device):
    graph, (out, x, weight) = scattered(60, radius=6.0), inputs(60, 3, 4, torch.float32)
    x[5] = torch.nan
    graph.edge_attr[7] = torch.nan
    arguments = [tensor.to(device) for tensor in (x, graph.edge_index, graph.edge_attr, weight)]
    found = class_sum(out.clone().to(device), *arguments, 5).isnan().cpu()
    expected = spline_sum_torch(out, x, graph.edge_index, graph.edge_attr, weight, 5).isnan()
    assert torch.equal(found, expected)
    assert expected.any(1).sum() < 30


@pytest.mark.parametrize("node", [-1, 60])
def test_edges_of_nodes_that_do_not_exist_are_refused(node, device):
    graph, (out, x, weight) = scattered(60), inputs(60, 1, 4, torch.float32)
    graph.edge_index[0, 3] = node
    with pytest.raises(ValueError, match=f"edge_index names nodes .*{node}"):
        class_sum(out, x, graph.edge_index, graph.edge_attr, weight, 5)


def test_torch_computes_graphs_that_are_not_on_a_grid(device):
    graph, (out, x, weight) = scattered(200, radius=9.0), inputs(200, 1, 4, torch.float32)
    graph.edge_attr[:] = torch.rand(graph.edge_attr.shape)
    assert graph.num_edges > kernel.MOST
    assert class_sum(out, x, graph.edge_index, graph.edge_attr, weight, 5) is None
    assert class_sum(out, x, graph.edge_index[:, :0], graph.edge_attr[:0], weight, 5) is None


@pytest.mark.parametrize("pooling", ["max", "average"])
def test_networks_agree_with_the_cpu(pooling, device, on_triton):
    small = {"channels": (4, 6), "clusters": ((4, 4), (8, 8)), "sensor_size": (34, 34)}
    model = models.RGCNN(3, **small, pooling=pooling, dropout=0.0).double()
    batch = GraphBatch.from_graphs([scattered(50, seed, radius=5.0) for seed in range(2)])
    expected = model(batch)
    expected.square().sum().backward()
    gradients = [parameter.grad for parameter in model.parameters()]
    model.zero_grad()
    model.to(device)
    on_triton()
    found = model(batch.to(device))
    found.square().sum().backward()
    torch.testing.assert_close(found.cpu(), expected, rtol=1e-9, atol=1e-9)
    for parameter, gradient in zip(model.parameters(), gradients, strict=True):
        torch.testing.assert_close(parameter.grad.cpu(), gradient, rtol=1e-7, atol=1e-9)
