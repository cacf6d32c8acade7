"""Graph pooling over rectangular clusters (thesis eqs. 4.8, 4.9)."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Literal, NamedTuple

import torch
from torch import nn
from torch.autograd.function import once_differentiable

from nvsdata.data.graph import GraphBatch, grouped
from nvsdata.data.grid import cells, check_cluster, grid_shape
from nvsdata.data.pseudo import Reach, pseudo
from nvsdata.kernels.graph import pool as kernel
from nvsdata.models.spline import has_kernels, occurrences, widened


class GraphPool(nn.Module):
    """Pools the nodes of each cluster of pixels into one node.

    - `cluster`: (width, height) of a cluster in pixels
    - `sensor_size`: (width, height) in pixels
    - `mode`: "max" (default) or "average" of the features

    Takes and gives a `GraphBatch`. The new node lies at the floor of the mean position of its nodes (eq. 4.8), and
    its features are their maximum or mean (eq. 4.9); its `t` is their mean time, rounded down. There is one edge from
    a cluster to another if there is any edge from a node of one to a node of the other. Pseudo-coordinates are
    relative to `coarse_reach`; those of longer edges are 1. ValueError for an unknown mode, or clusters of less than
    a pixel.
    """

    def __init__(
        self, cluster: tuple[int, int], sensor_size: tuple[int, int], mode: Literal["max", "average"] = "max"
    ) -> None:
        super().__init__()
        check_cluster(cluster)
        if mode not in ("max", "average"):
            raise ValueError(f"pooling mode must be 'max' or 'average', not {mode!r}")
        self.cluster, self.mode = cluster, mode
        self.grid = grid_shape(sensor_size, cluster)

    def forward(self, batch: GraphBatch) -> GraphBatch:
        """Pool a batch; graphs without nodes remain without nodes."""
        structure = clusters_cpu if batch.pos.device.type == "cpu" else clusters_torch
        cluster, pos, t, graph, ptr, edges = structure(batch, self.cluster, self.grid)
        count = pos.shape[0]
        if has_kernels(batch.x):
            function = _MaxRows if self.mode == "max" else _MeanRows
            x = function.apply(batch.x, cluster, count)  # type: ignore[no-untyped-call]
        else:
            reduce = max_rows_torch if self.mode == "max" else mean_rows_torch
            x = reduce(batch.x, cluster, count)
        reach = coarse_reach(batch.reach, self.cluster)
        return replace(
            batch,
            x=x,
            pos=pos,
            t=t,
            edge_index=edges,
            edge_attr=pseudo(pos, t, edges, reach, batch.pseudo),
            reach=reach,
            batch=graph,
            ptr=ptr,
        )

    def extra_repr(self) -> str:
        return f"cluster={self.cluster}, mode={self.mode!r}"


def coarse_reach(reach: Reach, cluster: tuple[int, int]) -> Reach:
    """What the end of an axis of the pseudo-coordinates stands for after pooling.

    Centers of neighboring clusters are a cluster's side apart, and no less than edges were long before. On N-MNIST 92
    to 100% of the edges are no longer; those that are longer count as that.
    """
    return max(reach[0], cluster[0]), max(reach[1], cluster[1]), *reach[2:]


class Structure(NamedTuple):
    """The pooled graphs without their features."""

    cluster: torch.Tensor  # cluster of each node, int64 [N]
    pos: torch.Tensor
    t: torch.Tensor
    batch: torch.Tensor
    ptr: torch.Tensor
    edge_index: torch.Tensor


def clusters_cpu(batch: GraphBatch, cluster: tuple[int, int], grid: tuple[int, int]) -> Structure:
    """The pooled graphs, computed by our kernels on the CPU."""
    source, target, _ = grouped(batch.edge_index, batch.edge_attr, batch.num_nodes)
    found = kernel.clusters(batch.pos.numpy(), batch.t.numpy(), batch.ptr.numpy(), *cluster, *grid)
    edges = kernel.merged_edges(source.numpy(), target.numpy(), found[0], len(found[1]))
    return Structure(*map(torch.from_numpy, (*found, edges)))


def clusters_torch(batch: GraphBatch, cluster: tuple[int, int], grid: tuple[int, int]) -> Structure:
    """The pooled graphs, computed by torch on any device."""
    total = grid[0] * grid[1]
    occupied, index = torch.unique(batch.batch * total + cells(batch.pos, cluster, grid), return_inverse=True)
    count = occupied.numel()
    # float64: sums of whole pixels must be exact for the floor to be
    pos = mean_rows_torch(batch.pos.double(), index, count).floor().float()
    # from the earliest node's time on: a sum of dates in µs may be beyond int64
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
    """Mean of `x` [N, C] over clusters, on any device: [M, C]."""
    wide = widened(x)
    members = occurrences(cluster, count).to(wide.dtype).unsqueeze(1)
    return (wide.new_zeros(count, x.shape[1]).index_add(0, cluster, wide) / members).to(x.dtype)


def max_rows_torch(x: torch.Tensor, cluster: torch.Tensor, count: int) -> torch.Tensor:
    """Maximum of `x` [N, C] over clusters, on any device; the gradient goes to the first maximal node.

    NaN counts as larger than any number.
    """
    nodes, channels = x.shape
    where = cluster.unsqueeze(1).expand(nodes, channels)
    with torch.no_grad():
        best = x.new_zeros(count, channels).scatter_reduce(0, where, x, "amax", include_self=False)
        index = torch.arange(nodes, device=x.device).unsqueeze(1).expand(nodes, channels)
        # NaN equals nothing, so without isnan no node would be found for it
        index = torch.where((x == best[cluster]) | x.isnan(), index, nodes)
        first = torch.full((count, channels), nodes, device=x.device).scatter_reduce(0, where, index, "amin")
    return x.gather(0, first)


class _MaxRows(torch.autograd.Function):
    """`max_rows_torch` by our kernels, on the CPU."""

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
    """`mean_rows_torch` by our kernels, on the CPU."""

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
