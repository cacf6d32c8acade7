"""Graph2Grid as a layer (thesis 5.2.3)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import torch
from torch import nn

from nvsdata.data.graph import Graph, GraphBatch
from nvsdata.data.grid import check_cluster, grid_shape, to_grid

if TYPE_CHECKING:
    from torch_geometric.data import Data


class Graph2GridLayer(nn.Module):
    """Graphs to frames (eq. 5.1): a batch of sequences of S graphs to [B, C, S, H, W], with C features per node.

    - `cluster`: (width, height) of a cell in pixels
    - `sensor_size`: (width, height) in pixels; H x W cells cover it (30 x 30 for 240x180 and (8, 6))

    The features of a node go to the cell in which it lies; after a `GraphPool` with the same cluster it is the only
    node there. Empty cells, and graphs without nodes, are 0. Differentiable. ValueError for cells of less than a
    pixel.
    """

    def __init__(self, cluster: tuple[int, int], sensor_size: tuple[int, int]) -> None:
        super().__init__()
        check_cluster(cluster)
        self.cluster = cluster
        self.grid = grid_shape(sensor_size, cluster)

    def forward(self, graphs: Graph | Data) -> torch.Tensor:
        """Frames [B, C, S, H, W]; a single graph is a batch of one sequence with one graph."""
        batch = GraphBatch.of(graphs)
        return to_grid(batch.x, batch.pos, batch.batch, batch.num_graphs, batch.volumes, self.cluster, self.grid)

    def extra_repr(self) -> str:
        return f"cluster={self.cluster}, grid={self.grid}"
