"""Residual graph CNNs on sequences of graphs, with a 3D CNN on their grids (thesis 5.2 and 5.3.1)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Literal

import torch
from torch import nn

from nvsdata.data.graph import Graph
from nvsdata.models.graph_cnn import Kernel, Pooling, ResidualBlock, Size, activated_pool, check_pairs, input_of
from nvsdata.models.grid import Graph2GridLayer
from nvsdata.models.registry import register_network
from nvsdata.models.temporal import temporal_network

if TYPE_CHECKING:
    from torch_geometric.data import Data


@register_network("rgcnn3d")
class RGCNN3D(nn.Module):
    """(Res_g -> MaxP_g) x L on each graph -> Graph2Grid -> 3D CNN -> global average -> FC(num_classes).

    The network of thesis 5.2 and 5.3.1. The defaults are those for 240x180.

    - `num_classes`: number of scores
    - `temporal`: the 3D CNN of section 5.3.1: "plain", "inception" or "residual" (default)
    - `sensor_size`: (width, height) in pixels (default 240, 180)
    - `channels`: output channels of each of the L blocks (default 32, 64, 128)
    - `clusters`: (width, height) in pixels of the clusters of each of the L poolings (default (2, 2), (4, 3), (8, 6));
      the last one is also the cell of the grid
    - `kernel_size`: of the B-spline kernels, along each axis (default 5)
    - `in_channels`: features per node (default 1)
    - `dim`: pseudo-coordinates per edge, 2 (default), or 3 with time
    - `pooling`: of a cluster's features, "max" (default) or "average" (eq. 4.9)

    Takes a `GraphBatch` with `volumes` = S, as `collate` makes from sequences of S graphs, and `x` [N, in_channels],
    or PyTorch Geometric's `Batch` with `volumes`; gives class scores (logits) [B, num_classes]. ValueError for settings
    that don't fit together, graphs of a larger sensor, or another number of features.
    """

    def __init__(
        self,
        num_classes: int,
        *,
        temporal: Literal["plain", "inception", "residual"] = "residual",
        sensor_size: Size = (240, 180),
        channels: Sequence[int] = (32, 64, 128),
        clusters: Sequence[Size] = ((2, 2), (4, 3), (8, 6)),
        kernel_size: int = 5,
        in_channels: int = 1,
        dim: int = 2,
        pooling: Pooling = "max",
    ) -> None:
        super().__init__()
        check_pairs(channels, clusters)
        self.sensor_size, self.in_channels, self.dim = sensor_size, in_channels, dim
        layers: list[nn.Module] = []
        previous = in_channels
        for width, cluster in zip(channels, clusters, strict=True):
            layers.append(ResidualBlock(previous, width, Kernel(kernel_size, dim)))
            layers += activated_pool(cluster, sensor_size, pooling)
            previous = width
        self.spatial = nn.Sequential(*layers)
        self.grid = Graph2GridLayer(clusters[-1], sensor_size)
        self.temporal, width = temporal_network(temporal, previous)
        self.classify = nn.Linear(width, num_classes)

    def features(self, graphs: Graph | Data) -> torch.Tensor:
        """Output of the last pooling: [B, C, T', H', W']."""
        maps: torch.Tensor = self.temporal(self.grid(self.spatial(input_of(self, graphs))))
        return maps

    def forward(self, graphs: Graph | Data) -> torch.Tensor:
        """Class scores (logits) [B, num_classes] of B sequences of S graphs.

        ValueError for graphs of a larger sensor, or with another number of features.
        """
        scores: torch.Tensor = self.classify(self.features(graphs).mean((2, 3, 4)))
        return scores
