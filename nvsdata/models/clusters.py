"""Clusters of nodes, and the maximum or mean of their features: by our kernels, or by torch where there are none.

While torch traces a network (`torch.compile`, `torch.export`, tensors on the device "meta"), tensors have no values.
`GraphPool` then calls these functions as operators that are registered with torch; see `models.spline_sum`.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import torch
from torch.autograd.function import once_differentiable
from torch.library import custom_op, get_ctx

from nvsdata.data.graph import GraphBatch, grouped
from nvsdata.data.grid import cells
from nvsdata.kernels import triton
from nvsdata.kernels.graph import pool as kernel
from nvsdata.models.spline_sum import has_kernels, occurrences, traced, widened

Size = tuple[int, int]


class Structure(NamedTuple):
    """Pooled graphs without their features."""

    cluster: torch.Tensor  # cluster of each node, int64 [N]
    pos: torch.Tensor
    t: torch.Tensor
    batch: torch.Tensor
    ptr: torch.Tensor
    edge_index: torch.Tensor


def structure(batch: GraphBatch, cluster: Size, grid: Size) -> Structure:
    """Return the pooled graphs, without features.

    `cluster` is the (width, height) of a cluster in pixels, `grid` the number of (columns, rows) of clusters.
    """
    if traced(batch.pos):
        given = batch.pos, batch.t, batch.edge_index, batch.edge_attr, batch.batch, batch.ptr
        return Structure(*_structure(*given, list(cluster), list(grid)))
    return (clusters_cpu if batch.pos.device.type == "cpu" else clusters_torch)(batch, cluster, grid)


def pooled_rows(x: torch.Tensor, cluster: torch.Tensor, count: int, mode: str) -> torch.Tensor:
    """Return the maximum ("max") or mean ("average") of `x` [N, C] over each of `count` clusters, [count, C]."""
    if traced(x):
        pooled: torch.Tensor = _rows(x, cluster, count, mode)
        return pooled
    function: Any = None
    if has_kernels(x):
        function = _MaxRows if mode == "max" else _MeanRows
    elif triton.usable(x):
        function = _MaxSegments if mode == "max" else _MeanSegments
    if function:
        rows: torch.Tensor = function.apply(x, cluster, count)
        return rows
    return (max_rows_torch if mode == "max" else mean_rows_torch)(x, cluster, count)


def clusters_cpu(batch: GraphBatch, cluster: Size, grid: Size) -> Structure:
    """Return the pooled graphs, computed by our kernels on the CPU."""
    source, target, _ = grouped(batch.edge_index, batch.edge_attr, batch.num_nodes)
    found = kernel.clusters(batch.pos.numpy(), batch.t.numpy(), batch.ptr.numpy(), *cluster, *grid)
    edges = kernel.merged_edges(source.numpy(), target.numpy(), found[0], len(found[1]))
    return Structure(*map(torch.from_numpy, (*found, edges)))


def clusters_torch(batch: GraphBatch, cluster: Size, grid: Size) -> Structure:
    """Return the pooled graphs, computed by torch on any device."""
    total = grid[0] * grid[1]
    occupied, index = torch.unique(batch.batch * total + cells(batch.pos, cluster, grid), return_inverse=True)
    count = occupied.numel()
    # in float64, sums of whole pixels are exact, and so is the floor of their mean
    pos = mean_rows_torch(batch.pos.double(), index, count).floor().float()
    # times relative to the earliest node, because a sum of absolute times in µs may exceed int64
    first = batch.t.new_zeros(count).scatter_reduce_(0, index, batch.t, "amin", include_self=False)
    times = batch.t.new_zeros(count).index_add_(0, index, batch.t - first[index])
    t = first + torch.div(times, occurrences(index, count), rounding_mode="floor")
    graph = occupied // total
    sizes = occurrences(graph, batch.num_graphs)
    ptr = torch.cat((sizes.new_zeros(1), sizes.cumsum(0)))
    source, target = index[batch.edge_index]
    keys = torch.unique((target * count + source)[source != target])
    edges = torch.stack((keys % max(count, 1), keys // max(count, 1)))
    return Structure(index, pos, t, graph, ptr, edges)


def mean_rows_torch(x: torch.Tensor, cluster: torch.Tensor, count: int) -> torch.Tensor:
    """Return the mean of `x` [N, C] over each of `count` clusters, on any device: [count, C]."""
    wide = widened(x)
    members = occurrences(cluster, count).to(wide.dtype).unsqueeze(1)
    return (wide.new_zeros(count, x.shape[1]).index_add(0, cluster, wide) / members).to(x.dtype)


def max_rows_torch(x: torch.Tensor, cluster: torch.Tensor, count: int) -> torch.Tensor:
    """Return the maximum of `x` [N, C] over each of `count` clusters, on any device: [count, C].

    The gradient goes to the first node with the maximum. NaN counts as larger than any number.
    """
    nodes, channels = x.shape
    where = cluster.unsqueeze(1).expand(nodes, channels)
    with torch.no_grad():
        best = x.new_zeros(count, channels).scatter_reduce(0, where, x, "amax", include_self=False)
        index = torch.arange(nodes, device=x.device).unsqueeze(1).expand(nodes, channels)
        # NaN doesn't equal itself, so without isnan no node with a maximum of NaN would be found
        index = torch.where((x == best[cluster]) | x.isnan(), index, nodes)
        first = torch.full((count, channels), nodes, device=x.device).scatter_reduce(0, where, index, "amin")
    return x.gather(0, first)


class _MaxRows(torch.autograd.Function):
    """`max_rows_torch`, computed by our kernels on the CPU."""

    @staticmethod
    def forward(ctx: Any, x: torch.Tensor, cluster: torch.Tensor, count: int) -> torch.Tensor:
        best, where = kernel.max_rows(x.detach().contiguous().numpy(), cluster.numpy(), count)
        ctx.where, ctx.nodes = where, x.shape[0]
        return torch.from_numpy(best)

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, gradient: torch.Tensor) -> tuple[torch.Tensor, None, None]:
        back = kernel.max_rows_back(gradient.contiguous().numpy(), ctx.where, ctx.nodes)
        return torch.from_numpy(back), None, None


class _MeanRows(torch.autograd.Function):
    """`mean_rows_torch`, computed by our kernels on the CPU."""

    @staticmethod
    def forward(ctx: Any, x: torch.Tensor, cluster: torch.Tensor, count: int) -> torch.Tensor:
        mean, members = kernel.mean_rows(x.detach().contiguous().numpy(), cluster.numpy(), count)
        ctx.save_for_backward(cluster, torch.from_numpy(members))
        return torch.from_numpy(mean)

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, gradient: torch.Tensor) -> tuple[torch.Tensor, None, None]:
        cluster, members = ctx.saved_tensors
        return (gradient / members.unsqueeze(1))[cluster], None, None


class _MaxSegments(torch.autograd.Function):
    """`max_rows_torch`, computed by Triton."""

    @staticmethod
    def forward(ctx: Any, x: torch.Tensor, cluster: torch.Tensor, count: int) -> torch.Tensor:
        from nvsdata.kernels.triton.pool import max_rows, segments

        best, where = max_rows(x.contiguous(), *segments(cluster, count))
        ctx.save_for_backward(where)
        ctx.nodes = x.shape[0]
        return best

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, gradient: torch.Tensor) -> tuple[torch.Tensor, None, None]:
        (where,) = ctx.saved_tensors
        # a node has one cluster, so no two gradients are for the same value
        return gradient.new_zeros(ctx.nodes, gradient.shape[1]).scatter_(0, where, gradient), None, None


class _MeanSegments(_MeanRows):
    """`mean_rows_torch`, computed by Triton; the backward pass is that of the CPU."""

    @staticmethod
    def forward(ctx: Any, x: torch.Tensor, cluster: torch.Tensor, count: int) -> torch.Tensor:
        from nvsdata.kernels.triton.pool import mean_rows, segments

        order, start = segments(cluster, count)
        ctx.save_for_backward(cluster, start.diff())
        return mean_rows(x.contiguous(), order, start)


Tensors = tuple[torch.Tensor, torch.Tensor, torch.Tensor, torch.Tensor, torch.Tensor, torch.Tensor]


@custom_op("nvsdata::clusters", mutates_args=())
def _structure(
    pos: torch.Tensor,
    t: torch.Tensor,
    edge_index: torch.Tensor,
    edge_attr: torch.Tensor,
    batch: torch.Tensor,
    ptr: torch.Tensor,
    cluster: list[int],
    grid: list[int],
) -> Tensors:
    """Custom operator of torch for `structure`."""
    # the result doesn't depend on features: positions take their place
    given = GraphBatch(x=pos, pos=pos, t=t, edge_index=edge_index, edge_attr=edge_attr, batch=batch, ptr=ptr)
    found = structure(given, (cluster[0], cluster[1]), (grid[0], grid[1]))
    cluster_of, *others, edges = found
    return cluster_of, *others, edges.contiguous()  # type: ignore[return-value]


@_structure.register_fake
def _(
    pos: torch.Tensor,
    t: torch.Tensor,
    edge_index: torch.Tensor,
    edge_attr: torch.Tensor,
    batch: torch.Tensor,
    ptr: torch.Tensor,
    cluster: list[int],
    grid: list[int],
) -> Tensors:
    if pos.device.type == "meta":
        # the largest possible numbers, because the actual ones aren't known
        nodes: Any = min(pos.shape[0], (ptr.shape[0] - 1) * grid[0] * grid[1])
        edges: Any = edge_index.shape[1]
    else:
        nodes, edges = get_ctx().new_dynamic_size(), get_ctx().new_dynamic_size()
    return (
        batch.new_empty(pos.shape[0]),
        pos.new_empty(nodes, 2),
        t.new_empty(nodes),
        batch.new_empty(nodes),
        torch.empty_like(ptr),
        edge_index.new_empty(2, edges),
    )


@custom_op("nvsdata::pooled_rows", mutates_args=())
def _rows(x: torch.Tensor, cluster: torch.Tensor, count: int, mode: str) -> torch.Tensor:
    """Custom operator of torch for `pooled_rows`."""
    return pooled_rows(x, cluster, count, mode)


@_rows.register_fake
def _(x: torch.Tensor, cluster: torch.Tensor, count: int, mode: str) -> torch.Tensor:
    return x.new_empty(count, x.shape[1])


@custom_op("nvsdata::pooled_rows_backward", mutates_args=())
def _rows_backward(
    gradient: torch.Tensor, x: torch.Tensor, cluster: torch.Tensor, count: int, mode: str
) -> torch.Tensor:
    with torch.enable_grad():
        x = x.detach().requires_grad_()
        rows = pooled_rows(x, cluster, count, mode)
    (back,) = torch.autograd.grad(rows, x, gradient)
    return back


@_rows_backward.register_fake
def _(gradient: torch.Tensor, x: torch.Tensor, cluster: torch.Tensor, count: int, mode: str) -> torch.Tensor:
    return torch.empty_like(x)


def _keep(ctx: Any, inputs: tuple[Any, ...], output: torch.Tensor) -> None:
    x, cluster, ctx.count, ctx.mode = inputs
    ctx.save_for_backward(x, cluster)


def _back(ctx: Any, gradient: torch.Tensor) -> tuple[torch.Tensor | None, ...]:
    x, cluster = ctx.saved_tensors
    return _rows_backward(gradient.contiguous(), x, cluster, ctx.count, ctx.mode), None, None, None


_rows.register_autograd(_back, setup_context=_keep)
