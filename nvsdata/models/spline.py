"""B-spline graph convolution (thesis, eqs. 4.3 to 4.6; SplineCNN, Fey et al. 2018)."""

from __future__ import annotations

import math

import torch
from torch import nn

from nvsdata.common.validation import at_least
from nvsdata.data.graph import GraphBatch
from nvsdata.data.pseudo import origin
from nvsdata.models.spline_sum import self_loops, spline_sum, summed, traced


class SplineConv(nn.Module):
    """Graph convolution with an open B-spline kernel of degree 1 over two or more pseudo-coordinates.

        out(i) = 1/|N(i)| Σ_{j in N(i)} Σ_p B_p(u(i, j)) f(j) W_p + b  (+ f(i) W_root)

    N(i) are the sources of the edges whose target is i, p runs over the kernel_size^dim cells and B_p is the product of
    the hat functions of the cell. Without neighbors the sum is 0. The thesis has no W_root; with `root_weight`
    a node also adds its own features, as in SplineCNN. Activation and batch normalization are separate layers.

    Args:
        in_channels: Features per node of the input.
        out_channels: Features per node of the output.
        kernel_size: Cells along each axis of the kernel (default 5).
        dim: Pseudo-coordinates of an edge (default 2).
        root_weight: True to add f(i) W_root (default False).
        bias: True (default) to add b.

    Attributes:
        weight: [kernel_size^dim, in_channels, out_channels], cell (p_x, p_y) at p_x + kernel_size * p_y.
        root: [in_channels, out_channels], or None.
        bias: [out_channels], or None.

    Raises:
        ValueError: For settings below 1.

    Example:
        >>> import torch
        >>> from nvsdata import models
        >>> edge_index, u = torch.tensor([[0, 1], [1, 0]]), torch.tensor([[0.0, 0.5], [1.0, 0.5]])
        >>> models.SplineConv(1, 8)(torch.ones(2, 1), edge_index, u).shape
        torch.Size([2, 8])
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
        """Sample weights uniformly from ±1 / sqrt(fan-in), and set the bias to 0.

        Small weights followed by batch normalization let Adam change their direction quickly.
        """
        bound = 1 / math.sqrt(self.kernel_size**self.dim * self.in_channels)
        nn.init.uniform_(self.weight, -bound, bound)
        if self.root is not None:
            nn.init.uniform_(self.root, -bound, bound)
        if self.bias is not None:
            nn.init.zeros_(self.bias)

    def forward(self, x: torch.Tensor, edge_index: torch.Tensor, edge_attr: torch.Tensor) -> torch.Tensor:
        """Convolve the features of nodes over edges. On the CPU, autocast doesn't change the precision.

        Args:
            x: Features of the nodes [N, in_channels].
            edge_index: Sources and targets, int64 [2, E].
            edge_attr: Pseudo-coordinates [E, dim] in [0, 1]. They get no gradient.

        Returns:
            Features [N, out_channels].

        Raises:
            ValueError: For edges of another `dim`.
        """
        if (given := edge_attr.shape[1]) != self.dim:
            raise ValueError(f"edges have {given} pseudo-coordinates, but the convolution takes {self.dim}")
        if x.device.type == "cpu" and torch.is_autocast_enabled("cpu"):
            # kernels don't support bfloat16
            with torch.autocast("cpu", enabled=False):
                return self.forward(x.to(self.weight.dtype), edge_index, edge_attr)
        out = _local(x, self.root, self.bias, self.out_channels)
        if traced(x):
            sums: torch.Tensor = summed(x, edge_index, edge_attr.detach(), self.weight, self.kernel_size)
            return out + sums
        return spline_sum(out, x, edge_index, edge_attr, self.weight, self.kernel_size)

    def extra_repr(self) -> str:
        return f"{self.in_channels}, {self.out_channels}, kernel_size={self.kernel_size}, dim={self.dim}"


def _local(x: torch.Tensor, root: torch.Tensor | None, bias: torch.Tensor | None, channels: int) -> torch.Tensor:
    """Return the terms f(i) W_root and b of `SplineConv`, [N, channels], in new memory."""
    if root is not None:
        return x @ root if bias is None else torch.addmm(bias, x, root)
    return x.new_zeros(x.shape[0], channels) if bias is None else bias.repeat(x.shape[0], 1)


def add_self_loops(batch: GraphBatch) -> tuple[torch.Tensor, torch.Tensor]:
    """Return the edges of a batch with a self-loop of each node: `edge_index` int64 [2, E + N], `edge_attr` [E + N, D].

    N(i) then contains i itself, whose distance 0 is within every radius (thesis, eq. 4.2).
    """
    return self_loops(batch.edge_index, batch.edge_attr, batch.num_nodes, origin(batch.pseudo))
