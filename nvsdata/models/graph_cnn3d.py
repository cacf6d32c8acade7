"""Residual graph CNNs on sequences of graphs, with a 3D CNN on their grids (thesis, sections 5.2 and 5.3.1)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Literal

import torch
from torch import nn

from nvsdata.common.validation import positive
from nvsdata.data.graph import Graph
from nvsdata.models.graph_cnn import Kernel, Pooling, ResidualBlock, Size, activated_pool, check_pairs, input_of
from nvsdata.models.grid import Graph2GridLayer
from nvsdata.models.registry import register_network
from nvsdata.models.temporal import scaled, temporal_network

if TYPE_CHECKING:
    from torch_geometric.data import Data


@register_network("rgcnn3d")
class RGCNN3D(nn.Module):
    """Graph CNN and 3D CNN: (Res_g -> MaxP_g) x L on each graph -> Graph2Grid -> 3D CNN -> mean -> FC(num_classes).

    The network is that of the thesis, sections 5.2 and 5.3.1. It takes a `GraphBatch` with `x` [N, in_channels] and
    `volumes` = S, such as `collate` makes from sequences of S graphs; or PyTorch Geometric's `Batch` with `volumes`. It
    returns class scores (logits) [B, num_classes]. The defaults are those of the thesis for 240x180 pixels.

    Args:
        num_classes: Number of scores.
        temporal: 3D CNN (thesis, section 5.3.1): "plain", "inception" or "residual" (default).
        sensor_size: (width, height) in pixels (default (240, 180)).
        channels: Output channels of each of the L blocks (default (32, 64, 128)).
        clusters: (width, height) in pixels of the clusters of each of the L poolings (default (2, 2), (4, 3), (8, 6)).
            The last one is also the cell of the grid.
        kernel_size: Cells of the B-spline kernels along each axis (default 5).
        in_channels: Features per node (default 1).
        dim: Pseudo-coordinates per edge: 2 (default), or 3 with time.
        pooling: "max" (default) or "average" of the features of a cluster (thesis, eq. 4.9).
        width: Factor of the channels of all layers, graph and 3D convolutions, above 0 (default 1.0).

    Raises:
        ValueError: For settings that don't fit together, graphs of a larger sensor, or another number of features.

    Example:
        >>> import nvsdata
        >>> from nvsdata import models, transforms as T
        >>> graph = T.RadiusGraph()(nvsdata.Events([0, 9], [1, 2], [0, 1], [1, 0], (32, 32)))
        >>> batch, _ = nvsdata.collate([([graph] * 8, 0)])
        >>> model = models.RGCNN3D(11, temporal="plain", sensor_size=(32, 32), channels=(8,), clusters=((4, 4),)).eval()
        >>> model(batch).shape
        torch.Size([1, 11])
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
        width: float = 1.0,
    ) -> None:
        super().__init__()
        check_pairs(channels, clusters)
        positive("width", width)
        self.sensor_size, self.in_channels, self.dim = sensor_size, in_channels, dim
        layers: list[nn.Module] = []
        previous = in_channels
        for full, cluster in zip(channels, clusters, strict=True):
            out = scaled(full, width)
            layers.append(ResidualBlock(previous, out, Kernel(kernel_size, dim)))
            layers += activated_pool(cluster, sensor_size, pooling)
            previous = out
        self.spatial = nn.Sequential(*layers)
        self.grid = Graph2GridLayer(clusters[-1], sensor_size)
        self.temporal, last = temporal_network(temporal, previous, width)
        self.classify = nn.Linear(last, num_classes)

    def features(self, graphs: Graph | Data) -> torch.Tensor:
        """Return the output of the last pooling, [B, C, T', H', W']."""
        maps: torch.Tensor = self.temporal(self.grid(self.spatial(input_of(self, graphs))))
        return maps

    def forward(self, graphs: Graph | Data) -> torch.Tensor:
        """Return class scores (logits) [B, num_classes] of B sequences of S graphs.

        ValueError for graphs of a larger sensor, or with another number of features.
        """
        scores: torch.Tensor = self.classify(self.features(graphs).mean((2, 3, 4)))
        return scores
