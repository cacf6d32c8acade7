"""Other graph convolutions, for comparison with the B-spline convolution (thesis, Table 4.8).

Each takes features `x` [N, in_channels], `edge_index` int64 [2, E] (source, target) without self-loops, and
pseudo-coordinates `u` [E, dim], which only MoNet uses. It returns features [N, out_channels]. The output of a node
without neighbors depends on the node alone. The convolutions are written in plain torch, for any device.
"""

from __future__ import annotations

from collections.abc import Callable

import torch
from torch import nn

from nvsdata.common.validation import at_least
from nvsdata.models.spline_sum import occurrences


class GCNConv(nn.Module):
    """Graph convolution D^-1/2 (A + I) D^-1/2 X W + b (Kipf and Welling 2017); D counts edges with self-loops."""

    def __init__(self, in_channels: int, out_channels: int) -> None:
        super().__init__()
        self.linear = nn.Linear(in_channels, out_channels, bias=False)
        self.bias = nn.Parameter(torch.zeros(out_channels))

    def forward(self, x: torch.Tensor, edge_index: torch.Tensor, u: torch.Tensor) -> torch.Tensor:
        """Return features after the convolution, [N, out_channels]."""
        source, target = edge_index
        scale = (_degree(target, x) + 1).rsqrt().unsqueeze(1)
        scaled = self.linear(x) * scale
        return _gather(scaled, source, target, scaled) * scale + self.bias


class ChebConv(nn.Module):
    """Chebyshev polynomials up to degree K - 1 of the normalized Laplacian (Defferrard et al. 2016).

    With lambda_max = 2 the scaled Laplacian is -D^-1/2 A D^-1/2; D counts outgoing edges. `size` is K (default 3).
    """

    def __init__(self, in_channels: int, out_channels: int, size: int = 3) -> None:
        super().__init__()
        at_least("size", size, 1)
        self.linears = nn.ModuleList(nn.Linear(in_channels, out_channels, bias=False) for _ in range(size))
        self.bias = nn.Parameter(torch.zeros(out_channels))

    def forward(self, x: torch.Tensor, edge_index: torch.Tensor, u: torch.Tensor) -> torch.Tensor:
        """Return features after the convolution, [N, out_channels]."""
        source, target = edge_index
        degree = _degree(source, x)
        scale = torch.where(degree > 0, degree.clamp(min=1).rsqrt(), 0).unsqueeze(1)

        def laplacian(values: torch.Tensor) -> torch.Tensor:
            return -_gather(values * scale, source, target, torch.zeros_like(values)) * scale

        before, now = x, x
        out = self.bias
        for k, linear in enumerate(self.linears):
            if k == 1:
                before, now = now, laplacian(now)
            elif k > 1:
                before, now = now, 2 * laplacian(now) - before
            out = out + linear(now)
        return out


class GMMConv(nn.Module):
    """Graph convolution of MoNet (Monti et al. 2017), with a root weight.

    Each of `kernels` Gaussians of the pseudo-coordinates weights the mean over the neighbors.
    """

    def __init__(self, in_channels: int, out_channels: int, kernels: int = 25, dim: int = 2) -> None:
        super().__init__()
        self.kernels, self.out_channels = kernels, out_channels
        self.linear = nn.Linear(in_channels, out_channels * kernels, bias=False)
        self.root = nn.Linear(in_channels, out_channels)
        self.mean = nn.Parameter(torch.rand(kernels, dim))
        self.deviation = nn.Parameter(torch.full((kernels, dim), 0.5))

    def forward(self, x: torch.Tensor, edge_index: torch.Tensor, u: torch.Tensor) -> torch.Tensor:
        """Return features after the convolution, [N, out_channels]."""
        source, target = edge_index
        apart = (u.unsqueeze(1) - self.mean) / (self.deviation**2 + 1e-15).sqrt()
        weights = torch.exp(-0.5 * (apart * apart).sum(2))
        out: torch.Tensor = self.root(x)
        neighbors = x[source]
        count = _degree(target, x).clamp(min=1).unsqueeze(1)
        # one kernel at a time, because all at once would take E x K x C numbers
        for weight, matrix in zip(weights.T, self.linear.weight.view(self.kernels, self.out_channels, -1), strict=True):
            summed = torch.zeros_like(x).index_add(0, target, weight.unsqueeze(1) * neighbors)
            out = out + summed / count @ matrix.T
        return out


class GINConv(nn.Module):
    """Graph isomorphism layer MLP((1 + eps) x + sum of neighbors) (Xu et al. 2019).

    The MLP has one hidden layer. eps is learned and starts at 0.
    """

    def __init__(self, in_channels: int, out_channels: int) -> None:
        super().__init__()
        self.mlp = nn.Sequential(nn.Linear(in_channels, out_channels), nn.ReLU(), nn.Linear(out_channels, out_channels))
        self.eps = nn.Parameter(torch.zeros(()))

    def forward(self, x: torch.Tensor, edge_index: torch.Tensor, u: torch.Tensor) -> torch.Tensor:
        """Return features after the convolution, [N, out_channels]."""
        source, target = edge_index
        out: torch.Tensor = self.mlp(_gather(x, source, target, (1 + self.eps) * x))
        return out


# constructors by name; they take (in_channels, out_channels, kernel_size, dim) of the B-spline convolution that they
# replace, and make `kernel_size` polynomials, or as many Gaussians as the B-spline kernel has cells
CONVOLUTIONS: dict[str, Callable[[int, int, int, int], nn.Module]] = {
    "gcn": lambda a, b, size, dim: GCNConv(a, b),
    "cheb": lambda a, b, size, dim: ChebConv(a, b, size),
    "monet": lambda a, b, size, dim: GMMConv(a, b, size**dim, dim),
    "gin": lambda a, b, size, dim: GINConv(a, b),
}


def _degree(ends: torch.Tensor, x: torch.Tensor) -> torch.Tensor:
    """Return the number of edges at each node, [N] in the type of `x`; `ends` are sources or targets."""
    return occurrences(ends, x.shape[0]).to(x.dtype)


def _gather(x: torch.Tensor, source: torch.Tensor, target: torch.Tensor, start: torch.Tensor) -> torch.Tensor:
    """Return `start` plus, for each node, the sum of `x` over the sources of its incoming edges."""
    # `index_select` is faster than `x[source]`
    return start.index_add(0, target, x.index_select(0, source))
