"""RG-CNN with two residual blocks in PyTorch Geometric and torch_spline_conv, for comparison."""

from __future__ import annotations

import torch
from torch import nn
from torch_geometric.data import Data
from torch_geometric.nn import max_pool
from torch_geometric.transforms import Cartesian
from torch_spline_conv import spline_conv

CLUSTERS = (2, 4, 7)


class PygSplineConv(nn.Module):
    """B-spline convolution as PyTorch Geometric built it on torch_spline_conv, before it required pyg-lib."""

    def __init__(self, a: int, b: int, kernel_size: int) -> None:
        super().__init__()
        self.weight = nn.Parameter(torch.randn(kernel_size**2, a, b) / (kernel_size * a**0.5))
        self.root, self.bias = nn.Parameter(torch.randn(a, b) / a**0.5), nn.Parameter(torch.zeros(b))
        self.register_buffer("size", torch.tensor([kernel_size, kernel_size]))
        self.register_buffer("open", torch.ones(2, dtype=torch.uint8))

    def forward(self, x: torch.Tensor, edges: torch.Tensor, u: torch.Tensor) -> torch.Tensor:
        out: torch.Tensor = spline_conv(x, edges, u, self.weight, self.size, self.open, 1, True, self.root, self.bias)
        return out


class PygResidual(nn.Module):
    """Residual block: a convolution, and a shortcut with a kernel of size 1."""

    def __init__(self, a: int, b: int) -> None:
        super().__init__()
        self.conv, self.norm = PygSplineConv(a, b, 5), nn.BatchNorm1d(b)
        self.shortcut, self.shortcut_norm = PygSplineConv(a, b, 1), nn.BatchNorm1d(b)

    def forward(self, x: torch.Tensor, edges: torch.Tensor, u: torch.Tensor) -> torch.Tensor:
        return torch.relu(self.norm(self.conv(x, edges, u)) + self.shortcut_norm(self.shortcut(x, edges, u)))


class PyGRGCNN(nn.Module):
    """RG-CNN for N-MNIST: a convolution and two residual blocks, each followed by max pooling."""

    def __init__(self) -> None:
        super().__init__()
        self.first, self.norm = PygSplineConv(1, 32, 5), nn.BatchNorm1d(32)
        self.blocks = nn.ModuleList([PygResidual(32, 64), PygResidual(64, 128)])
        self.hidden, self.classify = nn.Linear(25 * 128, 128), nn.Linear(128, 10)
        self.dropout = nn.Dropout(0.5)

    def forward(self, given: Data) -> torch.Tensor:
        data = Data(x=given.x, pos=given.pos, edge_index=given.edge_index, edge_attr=given.edge_attr)
        data.batch = given.batch
        graphs = given.ptr.numel() - 1
        data.x = torch.relu(self.norm(self.first(data.x, data.edge_index, data.edge_attr)))
        data = self.pool(data, CLUSTERS[0])
        for block, side in zip(self.blocks, CLUSTERS[1:], strict=True):
            data.x = block(data.x, data.edge_index, data.edge_attr)
            data = self.pool(data, side)
        cell = (data.pos / 7).long().clamp(0, 4)
        place = data.batch * 25 + cell[:, 1] * 5 + cell[:, 0]
        flat = data.x.new_zeros(graphs * 25, 128).index_copy(0, place, data.x)
        scores: torch.Tensor = self.classify(self.dropout(torch.relu(self.hidden(flat.view(graphs, -1)))))
        return scores

    @staticmethod
    def pool(data: Data, side: int) -> Data:
        cell = (data.pos / side).long()
        cluster = (data.batch * 34 + cell[:, 1]) * 34 + cell[:, 0]
        return max_pool(cluster, data, transform=Cartesian(cat=False))
