"""Graphs, B-spline convolutions and RG-CNN with two residual blocks in PyTorch Geometric and pyg-lib."""

from __future__ import annotations

import warnings
from collections.abc import Callable

import numpy as np
import pyg_lib  # noqa: F401  # without it, PyTorch Geometric has neither radius graphs nor B-spline convolutions
import torch
from torch import nn
from torch_geometric.data import Data
from torch_geometric.nn import SplineConv, max_pool, radius_graph
from torch_geometric.transforms import Cartesian

from nvsdata.data.events import Events

CLUSTERS = (2, 4, 7)

# it advises against its convolution on the CPU at each call
warnings.filterwarnings("ignore", "We do not recommend using the non-optimized CPU version")


def radius_graphs(events: Events, radius: float, degree: int, beta: float) -> Callable[[], Data]:
    """Return a function that makes edges and Cartesian pseudo-coordinates."""
    attributes = Cartesian(max_value=radius)

    def run() -> Data:
        scaled = (events.t - events.start) * beta**0.5
        pos = torch.from_numpy(np.stack([events.x, events.y, scaled], 1).astype(np.float32))
        edges = radius_graph(pos, radius, max_num_neighbors=degree)
        made: Data = attributes(Data(x=torch.from_numpy(events.p * 2.0 - 1), pos=pos[:, :2], edge_index=edges))
        return made

    return run


def spline_layer(a: int, b: int, kernel_size: int) -> Callable[..., torch.Tensor]:
    """Return a function of features, edges, pseudo-coordinates and weights: a convolution without root and bias."""
    layer = SplineConv(a, b, 2, kernel_size, root_weight=False, bias=False)

    def run(x: torch.Tensor, edges: torch.Tensor, u: torch.Tensor, weight: torch.Tensor) -> torch.Tensor:
        out: torch.Tensor = torch.func.functional_call(layer.to(x.device), {"weight": weight}, (x, edges, u))
        return out

    return run


class PygResidual(nn.Module):
    """Residual block: a convolution, and a shortcut with a kernel of size 1."""

    def __init__(self, a: int, b: int) -> None:
        super().__init__()
        self.conv, self.norm = SplineConv(a, b, 2, 5), nn.BatchNorm1d(b)
        self.shortcut, self.shortcut_norm = SplineConv(a, b, 2, 1), nn.BatchNorm1d(b)

    def forward(self, x: torch.Tensor, edges: torch.Tensor, u: torch.Tensor) -> torch.Tensor:
        return torch.relu(self.norm(self.conv(x, edges, u)) + self.shortcut_norm(self.shortcut(x, edges, u)))


class PyGRGCNN(nn.Module):
    """RG-CNN for N-MNIST: a convolution and two residual blocks, each followed by max pooling."""

    def __init__(self) -> None:
        super().__init__()
        self.first, self.norm = SplineConv(1, 32, 2, 5), nn.BatchNorm1d(32)
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
