import itertools

import numpy as np
import pytest
import torch
from by_hand import hat, slow_spline_conv
from hypothesis import given, settings
from hypothesis import strategies as st

from nvsdata import Graph, GraphBatch
from nvsdata.models import SplineConv
from nvsdata.models import spline as module
from nvsdata.models.spline_sum import spline_sum, spline_sum_torch


def random_case(seed, channels=(3, 4), nodes=12, edges=40, dtype=torch.float64, grid=None, dim=2):
    generator = torch.Generator().manual_seed(seed)
    x = torch.randn(nodes, channels[0], generator=generator, dtype=dtype)
    edge_index = torch.randint(nodes, (2, edges), generator=generator)
    u = torch.rand(edges, dim, generator=generator, dtype=dtype)
    if grid:
        u = (u * grid).round() / grid
    return x, edge_index, u


def relative_error(a, b):
    return np.abs(a.detach().numpy() - b).max() / max(np.abs(b).max(), 1e-30)


@pytest.mark.parametrize(("dtype", "tolerance"), [(torch.float64, 1e-12), (torch.float32, 1e-4)])
@pytest.mark.parametrize("size", [1, 2, 3, 5])
@pytest.mark.parametrize("grid", [None, 4])
@pytest.mark.parametrize("dim", [1, 2, 3])
def test_forward_is_equation_4_6(spline_way, dtype, tolerance, size, grid, dim):
    x, edge_index, u = random_case(1, dtype=dtype, grid=grid, dim=dim)
    conv = SplineConv(3, 4, kernel_size=size, dim=dim, root_weight=True).to(dtype)
    assert conv.weight.shape == (size**dim, 3, 4)
    torch.nn.init.normal_(conv.bias)
    expected = slow_spline_conv(x, edge_index, u, conv.weight, size, conv.bias, conv.root)
    assert relative_error(conv(x, edge_index, u), expected) < tolerance


@pytest.mark.parametrize(("dim", "size"), [(2, 5), (2, 7), (3, 3), (3, 4)])
@settings(max_examples=25)
@given(seed=st.integers(0, 10**6), nodes=st.integers(1, 15), edges=st.integers(0, 40), channels=st.integers(1, 9))
def test_any_graph_in_any_edge_order(spline_way, dim, size, seed, nodes, edges, channels):
    # beyond 0 and 1 pseudo-coordinates count as the ends
    x, edge_index, u = random_case(seed, (channels, 3), nodes, edges, grid=seed % 7, dim=dim)
    conv = SplineConv(channels, 3, kernel_size=size, dim=dim, bias=False).double()
    expected = slow_spline_conv(x, edge_index, u, conv.weight, size)
    assert np.allclose(conv(x, edge_index, u).detach().numpy(), expected, atol=1e-12)
    stretched = 3 * u - 1
    expected = slow_spline_conv(x, edge_index, stretched.clamp(0, 1), conv.weight, size)
    assert np.allclose(conv(x, edge_index, stretched).detach().numpy(), expected, atol=1e-12)


@pytest.mark.parametrize("size", [1, 3])
@pytest.mark.parametrize("grid", [None, 2])
@pytest.mark.parametrize("dim", [2, 3])
def test_gradients_are_those_of_finite_differences(spline_way, size, grid, dim):
    x, edge_index, u = random_case(2, (2, 2), nodes=5, edges=12, grid=grid, dim=dim)
    conv = SplineConv(2, 2, kernel_size=size, dim=dim, root_weight=True).double()
    inputs = (x.requires_grad_(), conv.weight, conv.root, conv.bias)

    def function(x, *_):
        return conv(x, edge_index, u)

    assert torch.autograd.gradcheck(function, inputs)


@pytest.mark.parametrize(("dtype", "tolerance"), [(torch.float64, 1e-12), (torch.float32, 1e-4)])
@pytest.mark.parametrize("dim", [2, 3])
def test_gradients_are_those_of_the_sum_over_edges(dtype, tolerance, dim):
    """Of many channels, by products of matrices and in plain torch: each edge's share, in float64."""
    x, edge_index, u = random_case(3, (16, 32), 50, 300, dtype, dim=dim)
    weight = torch.randn(5**dim, 16, 32, dtype=dtype)
    upstream = torch.randn(50, 32, dtype=dtype)
    gradients = []
    for function in (spline_sum, spline_sum_torch):
        a, w = x.clone().requires_grad_(), weight.clone().requires_grad_()
        function(torch.zeros(50, 32, dtype=dtype), a, edge_index, u, w, 5).backward(upstream)
        gradients.append((a.grad, w.grad))
    expected = np.zeros(x.shape), np.zeros(weight.shape)
    a, w, up = (tensor.double().numpy() for tensor in (x, weight, upstream))
    degree = torch.bincount(edge_index[1], minlength=50).tolist()
    for (source, target), place in zip(edge_index.T.tolist(), u.tolist(), strict=True):
        for knots in itertools.product(range(5), repeat=dim):
            basis = np.prod([hat(k, v, 5) for k, v in zip(knots, place, strict=True)]) / degree[target]
            if basis:
                cell = sum(k * 5**axis for axis, k in enumerate(knots))
                expected[0][source] += basis * w[cell] @ up[target]
                expected[1][cell] += basis * np.outer(a[source], up[target])
    for found in gradients:
        for gradient, right in zip(found, expected, strict=True):
            assert relative_error(gradient, right) < tolerance


@pytest.mark.parametrize("dim", [2, 3])
def test_each_cell_has_its_place(spline_way, dim):
    """An edge at a knot touches that cell only, with the whole share."""
    size = 3
    conv = SplineConv(1, 1, kernel_size=size, dim=dim, bias=False).double()
    conv.weight.data = torch.arange(size**dim, dtype=torch.float64).view(-1, 1, 1)
    knots = torch.tensor(list(itertools.product(range(size), repeat=dim)))
    edges = torch.tensor([[0] * len(knots), range(1, 1 + len(knots))])
    out = conv(torch.ones(1 + len(knots), 1, dtype=torch.float64), edges, knots / (size - 1.0))
    assert out[1:, 0].tolist() == (knots * size ** torch.arange(dim)).sum(1).tolist()


@pytest.mark.parametrize("given", [1, 2, 3, 4])
def test_edges_of_another_dimension_are_refused(spline_way, given):
    dim = 2 if given != 2 else 3
    conv = SplineConv(1, 2, dim=dim)
    with pytest.raises(ValueError, match=f"edges have {given} pseudo-coordinates, but the convolution takes {dim}"):
        conv(torch.ones(3, 1), torch.tensor([[0], [1]]), torch.full((1, given), 0.5))


def test_a_node_without_neighbors_gets_zero(spline_way):
    conv = SplineConv(1, 2, bias=False)
    out = conv(torch.ones(3, 1), torch.tensor([[0], [1]]), torch.tensor([[0.5, 0.5]]))
    assert out[0].tolist() == [0, 0]
    assert out[2].tolist() == [0, 0]
    assert (out[1] != 0).all()


@pytest.mark.parametrize("nodes", [0, 1, 4])
def test_no_edges(spline_way, nodes):
    conv = SplineConv(2, 3)
    x = torch.ones(nodes, 2, requires_grad=True)
    out = conv(x, torch.empty(2, 0, dtype=torch.int64), torch.empty(0, 2))
    out.sum().backward()
    assert out.shape == (nodes, 3)
    assert (x.grad == 0).all()


# where a node is, as seen from itself
CENTERS = {"abs": (0.0, 0.0), "signed": (0.5, 0.5), "signed-time": (0.5, 0.5, 0.5)}


@pytest.mark.parametrize("kind", CENTERS)
@given(seed=st.integers(0, 10**6), nodes=st.integers(0, 9), edges=st.integers(0, 30))
def test_self_loops_join_every_node_to_itself(kind, seed, nodes, edges):
    edges = edges if nodes else 0
    x, edge_index, u = random_case(seed, nodes=max(nodes, 1), edges=edges, dim=len(CENTERS[kind]))
    x = x[:nodes]
    graph = Graph(x, x[:, :2], torch.zeros(nodes, dtype=torch.int64), edge_index, u, pseudo=kind)
    index, attributes = module.add_self_loops(GraphBatch.of(graph))

    def listed(index, u):
        return sorted(zip(*index.tolist(), map(tuple, u.tolist()), strict=True))

    loops = [(i, i, CENTERS[kind]) for i in range(nodes)]
    assert listed(index, attributes) == sorted(listed(edge_index, u) + loops)
    assert (index[1].diff() >= 0).all()


@pytest.mark.parametrize(
    ("edge", "u", "message"),
    [(5, 0.5, "nodes from 0 to 5; there are 3"), (-1, 0.5, "nodes from -1"), (1, float("nan"), "not finite")],
)
@pytest.mark.parametrize("channels", [1, 32])
def test_impossible_edges_are_refused(edge, u, message, channels):
    with pytest.raises(ValueError, match=message):
        SplineConv(channels, 2)(torch.ones(3, channels), torch.tensor([[0], [edge]]), torch.tensor([[u, 0.5]]))


@pytest.mark.parametrize("channels", [1, 32])
@pytest.mark.parametrize("rows", [1, 3])
def test_pseudo_coordinates_of_other_edges_are_refused(rows, channels):
    with pytest.raises(ValueError, match=f"edge_attr has {rows} rows for 2 edges"):
        SplineConv(channels, 2)(torch.ones(3, channels), torch.tensor([[0, 1], [1, 2]]), torch.rand(rows, 2))


def test_sizes_below_one_are_refused():
    with pytest.raises(ValueError, match="kernel_size must be at least 1, not 0"):
        SplineConv(1, 1, kernel_size=0)
    with pytest.raises(ValueError, match="dim must be at least 1, not 0"):
        SplineConv(1, 1, dim=0)
