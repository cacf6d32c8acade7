"""Benchmarks of single graph convolutions, forward and backward pass."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from itertools import product
from typing import Any

import torch

from nvsdata import transforms as T
from nvsdata.benchmarks.case import Case, Options, PreparedCase
from nvsdata.benchmarks.inputs import outlines, random_events
from nvsdata.benchmarks.networks import synchronize
from nvsdata.data.events import Events
from nvsdata.data.graph import GraphBatch
from nvsdata.models.conv import CONVOLUTIONS
from nvsdata.models.pool import GraphPool
from nvsdata.models.spline import add_self_loops
from nvsdata.models.spline_sum import spline_sum

CHANNELS = (1, 32), (32, 64), (64, 128), (128, 256)  # in and out
KERNEL = 5
RELATIVE = "largest difference of result and gradients from float64, relative to the largest value"
Convolution = Callable[[torch.Tensor, torch.Tensor, torch.Tensor, torch.Tensor], torch.Tensor]


def cases(options: Options) -> list[Case]:
    """Return the cases: B-spline and other convolutions, compared with other libraries, and pooling."""
    return [replace(case, device=options.device) for some in (_splines, _others, _pools) for case in some(options)]


def _splines(options: Options) -> Iterator[Case]:
    for channels in CHANNELS:
        benchmark = f"a B-spline convolution {channels[0]} -> {channels[1]}"
        case = partial(Case, "layers", benchmark, error_kind=RELATIVE)
        yield case(partial(_spline, options, channels, _ours), default=True)
        if not options.quick or channels in CHANNELS[:2]:
            # it takes minutes for larger ones
            yield case(partial(_spline, options, channels, partial(_by_pyg, channels)), library="torch_geometric")
        yield case(partial(_spline, options, channels, _gathered), library="torch, gather and scatter", package="torch")


def _others(options: Options) -> Iterator[Case]:
    for name in CONVOLUTIONS:
        case = partial(Case, "layers", f"{name} 64 -> 128", error_kind=RELATIVE)
        yield case(partial(_other, options, name, False), default=True)
        yield case(partial(_other, options, name, True), library="torch_geometric")


def _pools(options: Options) -> Iterator[Case]:
    """Yield cases of pooling with nodes in more and more of the clusters."""
    for fraction in (0.01, 0.1, 1.0):
        yield Case(
            *("layers", "pooling of 20,000 nodes in a part of the clusters", partial(_pool, options, fraction)),
            settings={"fraction of clusters": fraction},
            axis="fraction of clusters",
        )


def _batch(options: Options) -> GraphBatch:
    graphs = [T.RadiusGraph()(outlines(1_000, seed=seed)) for seed in range(2 if options.quick else 16)]
    return GraphBatch.from_graphs(graphs).to(options.device)


def _spline(options: Options, channels: tuple[int, int], make: Callable[[], Convolution]) -> PreparedCase:
    """Prepare a B-spline convolution with self-loops, as in the networks."""
    batch = _batch(options)
    edges, u = add_self_loops(batch)
    torch.manual_seed(0)
    weight = torch.randn(KERNEL**2, *channels, device=options.device) / (KERNEL * channels[0] ** 0.5)
    given = torch.randn(batch.num_nodes, channels[0], device=options.device), weight
    exact = _outcome(gather_and_scatter, edges, u, tuple(tensor.double() for tensor in given), "cpu")
    apply = make()
    return PreparedCase(lambda: _outcome(apply, edges, u, given, options.device), partial(_largest_difference, exact))


def _outcome(
    apply: Convolution, edges: torch.Tensor, u: torch.Tensor, given: tuple[torch.Tensor, ...], device: str
) -> tuple[torch.Tensor, ...]:
    """Return the result of a layer, and the gradients of a weighted sum of it.

    Without weights, the gradient of every output would be 1.
    """
    x, weight = (tensor.detach().requires_grad_() for tensor in given)
    out = apply(x, edges, u, weight)
    weighted = out * torch.linspace(-1, 1, out.shape[1], dtype=out.dtype, device=out.device)
    gradients = torch.autograd.grad(weighted.sum(), (x, weight))
    synchronize(device)
    return out.detach(), *gradients


def _largest_difference(exact: tuple[torch.Tensor, ...], found: tuple[torch.Tensor, ...]) -> float:
    pairs = zip(found, exact, strict=True)
    return max(((ours.double() - best).abs().max() / best.abs().max()).item() for ours, best in pairs)


def _ours() -> Convolution:
    return lambda x, edges, u, w: spline_sum(x.new_zeros(x.shape[0], w.shape[2]), x, edges, u, w, KERNEL)


def _by_pyg(channels: tuple[int, int]) -> Convolution:
    from nvsdata.benchmarks.peers.pyg import spline_layer

    return spline_layer(*channels, KERNEL)


def _gathered() -> Convolution:
    return gather_and_scatter


def gather_and_scatter(x: torch.Tensor, edges: torch.Tensor, u: torch.Tensor, weight: torch.Tensor) -> torch.Tensor:
    """Compute a B-spline convolution directly.

    Features of all nodes are multiplied by the weights of all cells of the kernel, gathered and summed along edges.

    Args:
        x: Features [N, in].
        edges: Source and target of each edge [2, E].
        u: Pseudo-coordinates [E, 2] in [0, 1].
        weight: Weights [25, in, out].

    Returns:
        Mean over the edges of each target, [N, out].
    """
    source, target = edges
    v = u.to(x.dtype) * (KERNEL - 1)
    lower = v.floor().clamp(max=KERNEL - 2).long()
    upper = v - lower
    degree = torch.bincount(target, minlength=x.shape[0]).clamp(min=1).to(x.dtype)
    products = torch.einsum("nc,kco->nko", x, weight).flatten(0, 1)
    out = x.new_zeros(x.shape[0], weight.shape[2])
    for a, b in product((0, 1), (0, 1)):
        fraction = (upper[:, 0] if a else 1 - upper[:, 0]) * (upper[:, 1] if b else 1 - upper[:, 1])
        row = source * KERNEL**2 + lower[:, 0] + a + KERNEL * (lower[:, 1] + b)
        out = out.index_add(0, target, (fraction / degree[target]).unsqueeze(1) * products[row])
    return out


def _other(options: Options, name: str, pyg: bool) -> PreparedCase:
    batch = _batch(options)
    torch.manual_seed(0)
    ours = CONVOLUTIONS[name](64, 128, KERNEL, 2).to(options.device)
    layer = _of_pyg(name, ours) if pyg else ours
    x = torch.randn(batch.num_nodes, 64, device=options.device)
    with_edges = (batch.edge_index,) if pyg and name != "monet" else (batch.edge_index, batch.edge_attr)

    def run(layer: Any = layer, x: torch.Tensor = x, rest: Any = with_edges) -> tuple[torch.Tensor, ...]:
        x = x.detach().requires_grad_()
        out = layer(x, *rest)
        weighted = out * torch.linspace(-1, 1, out.shape[1], dtype=out.dtype, device=out.device)
        (gradient,) = torch.autograd.grad(weighted.sum(), x)
        synchronize(options.device)
        return out.detach(), gradient

    exact = run(ours.double(), x.double(), (batch.edge_index, batch.edge_attr.double()))
    ours.float()
    return PreparedCase(run, partial(_largest_difference, exact))


def _of_pyg(name: str, ours: Any) -> Any:
    """Return the layer of PyTorch Geometric with the same weights."""
    from torch_geometric import nn as pyg

    device = next(ours.parameters()).device
    theirs: Any
    if name == "gcn":
        theirs = pyg.GCNConv(64, 128)
        theirs.lin.weight.data, theirs.bias.data = ours.linear.weight.data, ours.bias.data
    elif name == "cheb":
        theirs = pyg.ChebConv(64, 128, len(ours.linears))
        for mine, other in zip(ours.linears, theirs.lins, strict=True):
            other.weight.data = mine.weight.data
        theirs.bias.data = ours.bias.data
    elif name == "monet":
        theirs = pyg.GMMConv(64, 128, dim=2, kernel_size=ours.mean.shape[0])
        theirs.g.data = ours.linear.weight.data.T.contiguous()
        theirs.mu.data, theirs.sigma.data = ours.mean.data, ours.deviation.data
        theirs.root.weight.data, theirs.bias.data = ours.root.weight.data, ours.root.bias.data
    else:
        theirs = pyg.GINConv(ours.mlp, eps=ours.eps.item(), train_eps=True)
    return theirs.to(device)


def _pool(options: Options, fraction: float) -> PreparedCase:
    side = (fraction * 240 * 180) ** 0.5
    events = random_events(20_000, (max(round(side), 1), max(round(side), 1)), duration=30_000)
    events = Events(events.t, events.x, events.y, events.p, (240, 240))
    batch = GraphBatch.from_graphs([T.RadiusGraph(max_degree=8)(events)]).to(options.device)
    layer = GraphPool((4, 3), (240, 240))

    def run() -> GraphBatch:
        pooled: GraphBatch = layer(batch)
        synchronize(options.device)
        return pooled

    return PreparedCase(run, counters=lambda found: {"clusters": found.num_nodes})
