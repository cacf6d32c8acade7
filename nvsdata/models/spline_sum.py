"""Sums of a B-spline convolution over neighbors and kernel cells: by our kernels, or by torch where there are none.

While torch traces without values (`torch.compile`, `torch.export`, the meta device), layers call operators that are
registered with torch. These operators take about 30 µs more per call, and their backward pass computes the sum again.
"""

from __future__ import annotations

import itertools
from typing import Any

import torch
from torch.autograd.function import once_differentiable
from torch.library import custom_op

from nvsdata.data.graph import grouped
from nvsdata.kernels import triton
from nvsdata.kernels.graph import spline as kernel
from nvsdata.kernels.graph.edges import with_self_loops
from nvsdata.models.spline_classes import class_sum, corners

# up to this many (cell, channel) pairs, aggregating all of them is cheaper than finding those that occur
DENSE = 128


def traced(x: torch.Tensor) -> bool:
    """Return True while torch traces without values."""
    # a subclass of Tensor may contain values although its is_meta is True
    return torch.compiler.is_compiling() or (type(x) in (torch.Tensor, torch.nn.Parameter) and x.is_meta)


def spline_sum(
    out: torch.Tensor,
    x: torch.Tensor,
    edge_index: torch.Tensor,
    edge_attr: torch.Tensor,
    weight: torch.Tensor,
    kernel_size: int,
) -> torch.Tensor:
    """Return `out` [N, out_channels] plus the sum of `SplineConv`; on the CPU, our kernels add the sum in place."""
    if not has_kernels(x):
        added = class_sum(out, x, edge_index, edge_attr, weight, kernel_size) if triton.usable(x) else None
        return spline_sum_torch(out, x, edge_index, edge_attr, weight, kernel_size) if added is None else added
    dense = kernel_size == 1 or weight.shape[0] * x.shape[1] <= DENSE
    function = _DenseSum if dense else _SparseSum
    u = edge_attr.detach().to(x.dtype)
    given: torch.Tensor = function.apply(out, x, edge_index, u, weight, kernel_size)  # type: ignore[no-untyped-call]
    return given


def has_kernels(x: torch.Tensor) -> bool:
    """Return True if our kernels accept a tensor: one on the CPU, of single or double precision."""
    return x.device.type == "cpu" and x.dtype in (torch.float32, torch.float64)


def widened(x: torch.Tensor) -> torch.Tensor:
    """Return a tensor of half precision as float32, because sums may overflow or lose small values; others as is."""
    return x.float() if x.dtype in (torch.float16, torch.bfloat16) else x


def occurrences(index: torch.Tensor, count: int) -> torch.Tensor:
    """Return how often each integer below `count` occurs, int64 [count].

    Unlike for `bincount`, the host doesn't wait for the device.
    """
    return index.new_zeros(count).scatter_add_(0, index, torch.ones_like(index))


def spline_sum_torch(
    out: torch.Tensor,
    x: torch.Tensor,
    edge_index: torch.Tensor,
    edge_attr: torch.Tensor,
    weight: torch.Tensor,
    kernel_size: int,
) -> torch.Tensor:
    """`spline_sum` in plain torch, for any device: aggregate per (node, cell), then one matrix product."""
    source, target = edge_index
    nodes, cells = x.shape[0], weight.shape[0]
    wide = widened(x)
    degree = occurrences(target, nodes)
    gathered = wide[source] / degree[target].unsqueeze(1)
    sums = wide.new_zeros(nodes * cells, x.shape[1])
    for cell, share in corners(edge_attr.detach().to(wide.dtype), kernel_size):
        sums = sums.index_add(0, target * cells + cell, share.unsqueeze(1) * gathered)
    return torch.addmm(out, sums.view(nodes, cells * x.shape[1]).to(out.dtype), weight.reshape(-1, weight.shape[2]))


class _DenseSum(torch.autograd.Function):
    """Aggregate into every cell of every node, then one matrix product: for few channels or cells."""

    @staticmethod
    def forward(
        ctx: Any,
        out: torch.Tensor,
        x: torch.Tensor,
        edge_index: torch.Tensor,
        u: torch.Tensor,
        weight: torch.Tensor,
        size: int,
    ) -> torch.Tensor:
        source, target, u = grouped(edge_index, u, x.shape[0])
        given = x.detach().contiguous().numpy()
        sums = torch.from_numpy(kernel.dense_sums(source.numpy(), target.numpy(), u.numpy(), size, given))
        sums = sums.view(x.shape[0], weight.shape[0] * x.shape[1])
        ctx.mark_dirty(out)
        # the backward pass needs edges for the gradient of features only, which the first layer doesn't compute
        ctx.save_for_backward(sums, weight, *((source, target, u) if ctx.needs_input_grad[1] else ()))
        ctx.size = size
        return out.addmm_(sums, weight.reshape(-1, weight.shape[2]))

    @staticmethod
    @once_differentiable  # otherwise, second derivatives would be silently wrong
    def backward(ctx: Any, gradient: torch.Tensor) -> tuple[torch.Tensor | None, ...]:
        sums, weight, *edges = ctx.saved_tensors
        _, to_x, _, _, to_weight, _ = ctx.needs_input_grad
        d_weight = (sums.T @ gradient).view_as(weight) if to_weight else None
        d_x = None
        if to_x:
            cells, channels = weight.shape[:2]
            d_sums = (gradient @ weight.reshape(-1, weight.shape[2]).T).view(sums.shape[0] * cells, channels)
            source, target, u = (tensor.numpy() for tensor in edges)
            d_x = torch.from_numpy(kernel.dense_gradient(source, target, u, ctx.size, d_sums.numpy(), sums.shape[0]))
        return gradient, d_x, None, None, d_weight, None


class _SparseSum(torch.autograd.Function):
    """Aggregate only the (node, cell) pairs that occur, then one matrix product per cell."""

    @staticmethod
    def forward(
        ctx: Any,
        out: torch.Tensor,
        x: torch.Tensor,
        edge_index: torch.Tensor,
        u: torch.Tensor,
        weight: torch.Tensor,
        size: int,
    ) -> torch.Tensor:
        weight = weight.contiguous()
        source, target, u = grouped(edge_index, u, x.shape[0])
        plan = kernel.spline_plan(source.numpy(), target.numpy(), u.numpy(), size, x.shape[0])
        starts, row_node, entry_row, entry_source, share = plan
        sums = x.new_zeros(row_node.size, x.shape[1])
        kernel.add_shares(sums.numpy(), entry_row, x.detach().contiguous().numpy(), entry_source, share)
        buffer = _buffer(x, starts, weight.shape[2])
        onto, products = out.numpy(), buffer.numpy()
        for cell, a, b in _occupied(starts):
            torch.mm(sums[a:b], weight[cell], out=buffer[: b - a])
            kernel.add_rows(onto, row_node[a:b], products[: b - a])
        ctx.mark_dirty(out)
        ctx.save_for_backward(sums, weight)
        ctx.plan = plan
        return out

    @staticmethod
    @once_differentiable  # otherwise, second derivatives would be silently wrong
    def backward(ctx: Any, gradient: torch.Tensor) -> tuple[torch.Tensor | None, ...]:
        sums, weight = ctx.saved_tensors
        starts, row_node, entry_row, entry_source, share = ctx.plan
        _, to_x, _, _, to_weight, _ = ctx.needs_input_grad
        d_weight = torch.zeros_like(weight) if to_weight else None
        d_sums = torch.empty_like(sums) if to_x else None
        buffer = _buffer(sums, starts, weight.shape[2])
        nodes = torch.from_numpy(row_node)
        for cell, a, b in _occupied(starts):
            # the rows of one cell stay in the cache for both products
            rows = torch.index_select(gradient, 0, nodes[a:b], out=buffer[: b - a])
            if d_weight is not None:
                torch.mm(sums[a:b].T, rows, out=d_weight[cell])
            if d_sums is not None:
                torch.mm(rows, weight[cell].T, out=d_sums[a:b])
        d_x = None
        if d_sums is not None:
            d_x = sums.new_zeros(gradient.shape[0], sums.shape[1])
            kernel.add_shares(d_x.numpy(), entry_source, d_sums.numpy(), entry_row, share)
        return gradient, d_x, None, None, d_weight, None


@custom_op("nvsdata::spline_sum", mutates_args=())
def summed(
    x: torch.Tensor, edge_index: torch.Tensor, edge_attr: torch.Tensor, weight: torch.Tensor, kernel_size: int
) -> torch.Tensor:
    """Custom operator of torch: `spline_sum` added to zeros."""
    return spline_sum(x.new_zeros(x.shape[0], weight.shape[2]), x, edge_index, edge_attr, weight, kernel_size)


@summed.register_fake
def _(
    x: torch.Tensor, edge_index: torch.Tensor, edge_attr: torch.Tensor, weight: torch.Tensor, kernel_size: int
) -> torch.Tensor:
    return x.new_empty(x.shape[0], weight.shape[2])


@custom_op("nvsdata::spline_sum_backward", mutates_args=())
def _summed_backward(
    gradient: torch.Tensor,
    x: torch.Tensor,
    edge_index: torch.Tensor,
    edge_attr: torch.Tensor,
    weight: torch.Tensor,
    kernel_size: int,
) -> tuple[torch.Tensor, torch.Tensor]:
    with torch.enable_grad():
        x, weight = x.detach().requires_grad_(), weight.detach().requires_grad_()
        out = spline_sum(torch.zeros_like(gradient), x, edge_index, edge_attr, weight, kernel_size)
    d_x, d_weight = torch.autograd.grad(out, (x, weight), gradient)
    return d_x, d_weight


@_summed_backward.register_fake
def _(
    gradient: torch.Tensor,
    x: torch.Tensor,
    edge_index: torch.Tensor,
    edge_attr: torch.Tensor,
    weight: torch.Tensor,
    kernel_size: int,
) -> tuple[torch.Tensor, torch.Tensor]:
    return torch.empty_like(x), torch.empty_like(weight)


def _keep(ctx: Any, inputs: tuple[Any, ...], output: torch.Tensor) -> None:
    *tensors, ctx.size = inputs
    ctx.save_for_backward(*tensors)


def _back(ctx: Any, gradient: torch.Tensor) -> tuple[torch.Tensor | None, ...]:
    x, edge_index, edge_attr, weight = ctx.saved_tensors
    d_x, d_weight = _summed_backward(gradient.contiguous(), x, edge_index, edge_attr, weight, ctx.size)
    return d_x, None, None, d_weight, None


summed.register_autograd(_back, setup_context=_keep)


def self_loops(
    edge_index: torch.Tensor, edge_attr: torch.Tensor, nodes: int, at: float
) -> tuple[torch.Tensor, torch.Tensor]:
    """Return the edges and a self-loop of each node with pseudo-coordinates `at`, on the CPU grouped by target."""
    if traced(edge_index):
        looped: tuple[torch.Tensor, torch.Tensor] = _looped(edge_index, edge_attr, nodes, at)
        return looped
    if edge_index.device.type == "cpu":
        source, target, u = grouped(edge_index, edge_attr, nodes)
        edges, attributes = with_self_loops(source.numpy(), target.numpy(), u.numpy(), nodes, at)
        return torch.from_numpy(edges), torch.from_numpy(attributes)
    loops = torch.arange(nodes, device=edge_index.device).expand(2, nodes)
    there = edge_attr.new_full((nodes, edge_attr.shape[1]), at)
    return torch.cat((loops, edge_index), 1), torch.cat((there, edge_attr))


@custom_op("nvsdata::self_loops", mutates_args=())
def _looped(
    edge_index: torch.Tensor, edge_attr: torch.Tensor, nodes: int, at: float
) -> tuple[torch.Tensor, torch.Tensor]:
    return self_loops(edge_index, edge_attr, nodes, at)


@_looped.register_fake
def _(edge_index: torch.Tensor, edge_attr: torch.Tensor, nodes: int, at: float) -> tuple[torch.Tensor, torch.Tensor]:
    count = edge_index.shape[1] + nodes
    return edge_index.new_empty(2, count), edge_attr.new_empty(count, edge_attr.shape[1])


def _occupied(starts: Any) -> list[tuple[int, int, int]]:
    """Return the kernel cells that have rows, each with the range of its rows."""
    bounds = starts.tolist()
    return [(cell, a, b) for cell, (a, b) in enumerate(itertools.pairwise(bounds)) if b > a]


def _buffer(like: torch.Tensor, starts: Any, channels: int) -> torch.Tensor:
    """Return memory for the rows of the cell with the most rows."""
    return like.new_empty(int((starts[1:] - starts[:-1]).max()), channels)
