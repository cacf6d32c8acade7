"""Features and weights at the ends of float32, pseudo-coordinates at the ends of their range, against float64."""

import itertools
import math
from copy import deepcopy
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
import torch
from graphs import scattered

from nvsdata import GraphBatch, models
from nvsdata.models import BatchNorm, SplineConv
from nvsdata.models.clusters import max_rows_torch, mean_rows_torch
from nvsdata.models.conv import CONVOLUTIONS

LARGEST, SMALLEST = float(np.finfo(np.float32).max), float(np.finfo(np.float32).tiny)
# scales of features and of weights, whose product float32 holds
SCALES = [(x, w) for x in (1e-30, 1, 1e30) for w in (1e-30, 1, 1e30) if 1e-31 < x * w < 1e31]
SCALES += [(1e37, 0.1), (1e37, 1e-30)]


def case(scale, channels=3, nodes=60, edges=400):
    """Features, edges and pseudo-coordinates of a random graph."""
    generator = torch.Generator().manual_seed(0)
    x = torch.rand(nodes, channels, generator=generator) * 2 - 1
    return x * scale, torch.randint(nodes, (2, edges), generator=generator), torch.rand(edges, 2, generator=generator)


def error(found, exact):
    """The largest error, relative to the largest value."""
    found, exact = found.detach().double(), exact.detach().double()
    assert exact.isfinite().all()
    assert found.isfinite().all()
    return float((found - exact).abs().max() / exact.abs().max().clamp(min=1e-300))


@pytest.mark.parametrize(("of_x", "of_weights"), SCALES)
def test_spline_convolution_at_any_scale(spline_way, of_x, of_weights):
    x, edges, u = case(of_x)
    torch.manual_seed(0)
    conv = SplineConv(3, 4, root_weight=True)
    with torch.no_grad():
        for parameter in conv.parameters():
            parameter.mul_(of_weights)
    exact = deepcopy(conv).double()
    results = []
    for one, features in ((conv, x), (exact, x.double())):
        features.requires_grad_()
        out = one(features, edges, u.to(features.dtype))
        out.sum().backward()
        results.append((out, features.grad, one.weight.grad, one.root.grad))
    assert max(itertools.starmap(error, zip(*results, strict=True))) < 2e-6


@pytest.mark.parametrize("name", CONVOLUTIONS)
@pytest.mark.parametrize(("of_x", "of_weights"), SCALES)
def test_other_convolutions_at_any_scale(name, of_x, of_weights):
    x, edges, u = case(of_x)
    torch.manual_seed(0)
    conv = CONVOLUTIONS[name](3, 4, 5, 2)
    with torch.no_grad():
        for kind, parameter in conv.named_parameters():
            if kind == "linear.weight" or kind.startswith(("linears", "mlp.0", "root")):
                parameter.mul_(of_weights)
    assert error(conv(x, edges, u), deepcopy(conv).double()(x.double(), edges, u.double())) < 1e-6


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
@pytest.mark.parametrize("size", [1, 2, 3, 5, 8])
def test_splines_at_the_ends_of_their_range_and_at_knots(spline_way, dtype, size):
    """Both cells of an edge have the shares of the exact hat functions, which add up to 1."""
    number = np.float32 if dtype == torch.float32 else np.float64
    places = {0.0, 1.0, 0.5, 0.25, *(knot / max(size - 1, 1) for knot in range(size))}
    near = [number(place) for place in places]
    near += [np.nextafter(place, number(to)) for place in near for to in (-1, 2)] + [number(5e-324), number(1e-45)]
    near = sorted({float(place) for place in near})
    axis = Fraction(size - 1)
    conv = SplineConv(1, size, kernel_size=size, dim=1, bias=False).to(dtype)
    with torch.no_grad():
        conv.weight[:] = torch.eye(size, dtype=dtype)[:, None]
        u = torch.tensor(near, dtype=dtype)[:, None]
        edges = torch.stack((torch.zeros(len(near), dtype=torch.int64), torch.arange(len(near))))
        found = conv(torch.ones(len(near), 1, dtype=dtype), edges, u)
    for place, shares in zip(near, found.double().tolist(), strict=True):
        within = min(max(Fraction(place), Fraction(0)), Fraction(1)) * axis
        exact = [max(Fraction(0), 1 - abs(within - k)) if size > 1 else Fraction(1) for k in range(size)]
        assert sum(exact) == 1
        for share, wanted in zip(shares, exact, strict=True):
            assert abs(Fraction(share) - wanted) <= Fraction(float(np.finfo(number).eps)) * max(axis, 1)
        assert min(shares) >= 0
        assert abs(sum(shares) - 1) <= float(np.finfo(number).eps)


@pytest.mark.parametrize("training", [True, False])
@pytest.mark.parametrize("scale", [1e-38, 1e-30, 1e-5, 1, 1e5, 1e18])
def test_normalization_at_any_scale_whose_square_float32_holds(scale, training):
    x = case(scale)[0]
    norm = BatchNorm(3).train(training)
    exact = deepcopy(norm).double()
    assert error(norm(x), exact(x.double())) < 1e-6
    # variances below 1e-38 vanish beside eps
    assert norm.running_var.numpy() == pytest.approx(exact.running_var.numpy(), rel=1e-6, abs=1e-38)


@pytest.mark.parametrize("ratio", [1, 1e2, 1e4, 1e6])
def test_normalization_loses_as_many_digits_as_the_mean_exceeds_the_spread(ratio):
    x = ratio + torch.randn(500, 3, generator=torch.Generator().manual_seed(0))
    norm = BatchNorm(3)
    exact = deepcopy(norm).double()
    assert error(norm(x), exact(x.double())) < 1.2e-7 * max(ratio, 10)


@pytest.mark.parametrize("value", [0.0, 7.0, -1e4, 1e18, SMALLEST])
@pytest.mark.parametrize("nodes", [1, 2, 500])
def test_normalization_without_variance(value, nodes):
    x = torch.full((nodes, 3), value)
    norm = BatchNorm(3)
    exact = deepcopy(norm).double()
    found, wanted = norm(x), exact(x.double())
    assert found.isfinite().all()
    # nothing is left of values that are all alike; one of them alone is as it was, but for eps
    most = 1e-6 * abs(value) * 320
    assert (found - wanted).abs().max() <= most
    assert norm.running_var.tolist() == pytest.approx(exact.running_var.tolist(), abs=1e-6 * value**2)


@pytest.mark.parametrize("value", [LARGEST, -LARGEST, SMALLEST, 1e-45, 1e30])
def test_pooling_at_the_ends_of_float32(value):
    graph = GraphBatch.from_graphs([scattered(300)])
    graph.x[:] = torch.tensor(value)
    for mode in ("max", "average"):
        assert (models.GraphPool((34, 34), (34, 34), mode)(graph).x == graph.x[0]).all()
    alone = models.GraphPool((1, 1), (34, 34))(graph)
    grid = models.Graph2GridLayer((1, 1), (34, 34))(alone)
    assert set(grid.unique().tolist()) == {0.0, float(graph.x[0])}
    of = torch.zeros(300, dtype=torch.int64)
    assert max_rows_torch(graph.x, of, 1).item() == graph.x[0].item()
    if abs(value) < LARGEST / 300:
        assert mean_rows_torch(graph.x, of, 1).item() == pytest.approx(graph.x[0].item(), rel=1e-5)


def trained(build, of_weights, of_variance, **settings):
    """A network with weights and statistics of some size, that keeps its features within float32."""
    torch.manual_seed(0)
    model = build(4, sensor_size=(34, 34), **settings).eval()
    with torch.no_grad():
        for name, value in model.named_parameters():
            if value.ndim == 3 or name.endswith(("root", "conv.linear.weight")):
                value.mul_(of_weights)
        for name, value in model.named_buffers():
            if name.endswith("running_var"):
                value.fill_(of_variance).mul_(torch.rand(value.shape) + 0.5)
            elif name.endswith("running_mean"):
                value.copy_(torch.randn(value.shape) * math.sqrt(of_variance))
        for module_ in model.modules():
            if isinstance(module_, BatchNorm):
                torch.nn.init.uniform_(module_.weight, 0.5, 1.5)
                torch.nn.init.normal_(module_.bias)
    return model


@pytest.mark.parametrize("build", [models.RGCNN, models.GCNN])
@pytest.mark.parametrize(
    ("of_weights", "of_variance"), [(1, 1), (1e-30, 1e-38), (1e-30, 1), (1e15, 1e30), (1e18, 1e36), (1, 1e30), (1, 0)]
)
def test_networks_and_fused_networks_at_any_scale(build, of_weights, of_variance):
    model = trained(build, of_weights, of_variance)
    batch = GraphBatch.from_graphs([scattered(300, seed) for seed in range(4)])
    wide = replace(batch, x=batch.x.double())
    with torch.no_grad():
        exact = deepcopy(model).double()(wide)
        assert error(model(batch), exact) < 1e-5
        assert error(models.fused(model)(batch), exact) < 1e-5


@pytest.mark.parametrize("convolution", CONVOLUTIONS)
def test_networks_of_other_convolutions_at_any_scale(convolution):
    batch = GraphBatch.from_graphs([scattered(300, seed) for seed in range(4)])
    for of_weights, of_variance in ((1e-30, 1e-38), (1e15, 1e30)):
        model = trained(models.GCNN, of_weights, of_variance, convolution=convolution)
        wide = replace(batch, x=batch.x.double())
        with torch.no_grad():
            assert error(model(batch), deepcopy(model).double()(wide)) < 1e-5


def test_a_checkpoint_keeps_every_bit(tmp_path):
    """Also of zeros with a sign, numbers below the normal ones, infinities and NaN with a payload."""
    odd = [0.0, -0.0, 1e-45, -SMALLEST, LARGEST, math.inf, -math.inf, math.nan]
    model = models.RGCNN(4, sensor_size=(34, 34))
    with torch.no_grad():
        for value in model.state_dict().values():
            if value.is_floating_point():
                flat = value.view(-1)
                flat[:] = torch.tensor(odd).repeat(-(-flat.numel() // 8))[: flat.numel()]
                flat[-1:].view(torch.int32)[:] = 0x7FC0_1234
    models.save(model, tmp_path / "a.safetensors", classes=list("abcd"), transform=None, metrics={})
    back = models.load(tmp_path / "a.safetensors").model.state_dict()
    for name, value in model.state_dict().items():
        assert back[name].numpy().tobytes() == value.numpy().tobytes(), name
