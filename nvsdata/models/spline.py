"""B-spline graph convolution (thesis eqs. 4.3-4.6; SplineCNN, Fey et al. 2018)."""

from __future__ import annotations

import itertools
import math
from typing import Any

import torch
from torch import nn
from torch.autograd.function import once_differentiable

from nvsdata.common.validation import at_least
from nvsdata.data.graph import GraphBatch, grouped
from nvsdata.data.pseudo import origin
from nvsdata.kernels.graph import spline as kernel
from nvsdata.kernels.graph.edges import with_self_loops

# up to this many (cell, channel) pairs, aggregating all of them is cheaper than finding those that occur
DENSE = 128


class SplineConv(nn.Module):
    """Graph convolution with an open B-spline kernel of degree 1 over two or more pseudo-coordinates.

        out(i) = 1/|N(i)| Σ_{j in N(i)} Σ_p B_p(u(i, j)) f(j) W_p + b  (+ f(i) W_root)

    N(i) are the sources of the edges whose target is i, p runs over the kernel_size^dim cells and B_p is the product of
    the hat functions of the cell. Without neighbors the sum is 0. The thesis has no W_root; with `root_weight`
    a node also adds its own features, as in SplineCNN. Activation and batch normalization are separate layers.

    - `in_channels`, `out_channels`: features per node before and after
    - `kernel_size`: cells along each axis of the kernel (default 5)
    - `dim`: pseudo-coordinates of an edge (default 2)
    - `root_weight`: whether to add f(i) W_root (default False)
    - `bias`: whether to add b (default True)

    Weights: `weight` [kernel_size^dim, in_channels, out_channels], cell (p_x, p_y) at p_x + kernel_size * p_y;
    `root` [in_channels, out_channels]; `bias` [out_channels]. ValueError for settings below 1.
    """

    def __init__(
        self,
        in_channels: int,
        out_channels: int,
        *,
        kernel_size: int = 5,
        dim: int = 2,
        root_weight: bool = False,
        bias: bool = True,
    ) -> None:
        super().__init__()
        at_least("in_channels", in_channels, 1)
        at_least("out_channels", out_channels, 1)
        at_least("kernel_size", kernel_size, 1)
        at_least("dim", dim, 1)
        self.in_channels, self.out_channels, self.kernel_size, self.dim = in_channels, out_channels, kernel_size, dim
        self.weight = nn.Parameter(torch.empty(kernel_size**dim, in_channels, out_channels))
        self.root = nn.Parameter(torch.empty(in_channels, out_channels)) if root_weight else None
        self.bias = nn.Parameter(torch.empty(out_channels)) if bias else None
        self.reset_parameters()

    def reset_parameters(self) -> None:
        """Draw weights uniformly from ±1 / sqrt(fan-in), and set the bias to 0.

        Small weights followed by batch normalization let Adam change their direction quickly.
        """
        bound = 1 / math.sqrt(self.kernel_size**self.dim * self.in_channels)
        nn.init.uniform_(self.weight, -bound, bound)
        if self.root is not None:
            nn.init.uniform_(self.root, -bound, bound)
        if self.bias is not None:
            nn.init.zeros_(self.bias)

    def forward(self, x: torch.Tensor, edge_index: torch.Tensor, edge_attr: torch.Tensor) -> torch.Tensor:
        """Convolve `x` [N, in_channels] over `edge_index` int64 [2, E] with `edge_attr` [E, dim] in [0, 1].

        Returns [N, out_channels]. `edge_attr` gets no gradient. On the CPU, autocast doesn't change its precision.
        ValueError for edges of another `dim`.
        """
        if (given := edge_attr.shape[1]) != self.dim:
            raise ValueError(f"edges have {given} pseudo-coordinates, but the convolution takes {self.dim}")
        if x.device.type == "cpu" and torch.is_autocast_enabled("cpu"):
            # kernels don't support bfloat16
            with torch.autocast("cpu", enabled=False):
                return self.forward(x.to(self.weight.dtype), edge_index, edge_attr)
        out = _local(x, self.root, self.bias, self.out_channels)
        return spline_conv(out, x, edge_index, edge_attr, self.weight, self.kernel_size)

    def extra_repr(self) -> str:
        return f"{self.in_channels}, {self.out_channels}, kernel_size={self.kernel_size}, dim={self.dim}"


def _local(x: torch.Tensor, root: torch.Tensor | None, bias: torch.Tensor | None, channels: int) -> torch.Tensor:
    """The root and bias terms, [N, channels], in new memory."""
    if root is not None:
        return x @ root if bias is None else torch.addmm(bias, x, root)
    return x.new_zeros(x.shape[0], channels) if bias is None else bias.repeat(x.shape[0], 1)


def spline_conv(
    out: torch.Tensor,
    x: torch.Tensor,
    edge_index: torch.Tensor,
    edge_attr: torch.Tensor,
    weight: torch.Tensor,
    kernel_size: int,
) -> torch.Tensor:
    """`out` [N, out_channels] plus the sum of `SplineConv`: in place by our kernels on the CPU, by torch elsewhere."""
    if not has_kernels(x):
        return spline_conv_torch(out, x, edge_index, edge_attr, weight, kernel_size)
    dense = kernel_size == 1 or weight.shape[0] * x.shape[1] <= DENSE
    function = _DenseSplineConv if dense else _SparseSplineConv
    u = edge_attr.detach().to(x.dtype)
    summed: torch.Tensor = function.apply(out, x, edge_index, u, weight, kernel_size)  # type: ignore[no-untyped-call]
    return summed


def has_kernels(x: torch.Tensor) -> bool:
    """Whether our kernels take a tensor: on the CPU, of single or double precision. Torch's paths take any."""
    return x.device.type == "cpu" and x.dtype in (torch.float32, torch.float64)


def widened(x: torch.Tensor) -> torch.Tensor:
    """The tensor, or if it is of half precision, in which sums of many values get lost or overflow, as float32."""
    return x.float() if x.dtype in (torch.float16, torch.bfloat16) else x


def occurrences(index: torch.Tensor, count: int) -> torch.Tensor:
    """How often each number below `count` occurs, int64; the host doesn't wait for the device, as for `bincount`."""
    return index.new_zeros(count).scatter_add_(0, index, torch.ones_like(index))


def spline_conv_torch(
    out: torch.Tensor,
    x: torch.Tensor,
    edge_index: torch.Tensor,
    edge_attr: torch.Tensor,
    weight: torch.Tensor,
    kernel_size: int,
) -> torch.Tensor:
    """`spline_conv` in plain torch, for any device: aggregate per (node, cell), then one matrix product."""
    source, target = edge_index
    nodes, cells = x.shape[0], weight.shape[0]
    wide = widened(x)
    v = edge_attr.detach().to(wide.dtype).clamp(0, 1) * (kernel_size - 1)
    # NaN has no integer value; it stays in `upper`
    lower = v.nan_to_num(0).floor().clamp(max=max(kernel_size - 2, 0)).long()
    upper = v - lower
    degree = occurrences(target, nodes)
    gathered = wide[source] / degree[target].unsqueeze(1)
    sums = wide.new_zeros(nodes * cells, x.shape[1])
    for corner in itertools.product(range(min(kernel_size, 2)), repeat=v.shape[1]):
        row, share = target * cells, torch.ones_like(upper[:, 0])
        # number by number, because a tensor of the corner would have to be copied to the device
        for axis, above in enumerate(corner):
            row = row + (lower[:, axis] + above) * kernel_size**axis
            share = share * (upper[:, axis] if above else 1 - upper[:, axis])
        sums = sums.index_add(0, row, share.unsqueeze(1) * gathered)
    return torch.addmm(out, sums.view(nodes, cells * x.shape[1]).to(out.dtype), weight.reshape(-1, weight.shape[2]))


class _DenseSplineConv(torch.autograd.Function):
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
        # edges are needed again for the gradient of features only, which those of the first layer don't have
        ctx.save_for_backward(sums, weight, *((source, target, u) if ctx.needs_input_grad[1] else ()))
        ctx.size = size
        return out.addmm_(sums, weight.reshape(-1, weight.shape[2]))

    @staticmethod
    @once_differentiable  # or a second derivative would be wrong, silently
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


class _SparseSplineConv(torch.autograd.Function):
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
    @once_differentiable  # or a second derivative would be wrong, silently
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


def add_self_loops(batch: GraphBatch) -> tuple[torch.Tensor, torch.Tensor]:
    """The edges of a batch, and a self-loop of each node: `edge_index` int64 [2, E + N] and `edge_attr` [E + N, D].

    N(i) then contains i itself, whose distance 0 is within every radius (eq. 4.2).
    """
    edge_index, edge_attr, nodes, at = batch.edge_index, batch.edge_attr, batch.num_nodes, origin(batch.pseudo)
    if edge_index.device.type == "cpu":
        source, target, u = grouped(edge_index, edge_attr, nodes)
        edges, attributes = with_self_loops(source.numpy(), target.numpy(), u.numpy(), nodes, at)
        return torch.from_numpy(edges), torch.from_numpy(attributes)
    loops = torch.arange(nodes, device=edge_index.device).expand(2, nodes)
    there = edge_attr.new_full((nodes, edge_attr.shape[1]), at)
    return torch.cat((loops, edge_index), 1), torch.cat((there, edge_attr))


def _occupied(starts: Any) -> list[tuple[int, int, int]]:
    """Kernel cells that have rows, each with the range of its rows."""
    bounds = starts.tolist()
    return [(cell, a, b) for cell, (a, b) in enumerate(itertools.pairwise(bounds)) if b > a]


def _buffer(like: torch.Tensor, starts: Any, channels: int) -> torch.Tensor:
    """Memory for the rows of the cell with most rows."""
    return like.new_empty(int((starts[1:] - starts[:-1]).max()), channels)
