"""Layer that turns graphs into grids (Graph2Grid; thesis, section 5.2.3)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import torch
from torch import nn

from nvsdata.data.graph import Graph, GraphBatch
from nvsdata.data.grid import check_cluster, grid_shape, to_grid

if TYPE_CHECKING:
    from torch_geometric.data import Data


class Graph2GridLayer(nn.Module):
    """Layer from graphs to frames (thesis, eq. 5.1).

    A batch of B sequences of S graphs with C features per node becomes [B, C, S, H, W].
    The features of a node are written to the cell that contains it. After a `GraphPool` with the same cluster, each
    cell contains at most one node. Empty cells, and graphs without nodes, are 0. The layer is differentiable.

    Args:
        cluster: (width, height) of a cell in pixels.
        sensor_size: (width, height) in pixels. H x W cells cover it (30 x 30 for 240x180 and (8, 6)).

    Raises:
        ValueError: For cells smaller than a pixel.

    Example:
        >>> import nvsdata
        >>> from nvsdata import models, transforms as T
        >>> graph = T.RadiusGraph()(nvsdata.Events([0, 9], [1, 2], [0, 1], [1, 0], (34, 34)))
        >>> models.Graph2GridLayer((2, 2), (34, 34))(graph).shape
        torch.Size([1, 1, 1, 17, 17])
    """

    def __init__(self, cluster: tuple[int, int], sensor_size: tuple[int, int]) -> None:
        super().__init__()
        check_cluster(cluster)
        self.cluster = cluster
        self.grid = grid_shape(sensor_size, cluster)

    def forward(self, graphs: Graph | Data) -> torch.Tensor:
        """Return frames [B, C, S, H, W]. A single graph is a batch of one sequence with one graph."""
        batch = GraphBatch.of(graphs)
        return to_grid(batch.x, batch.pos, batch.batch, batch.num_graphs, batch.volumes, self.cluster, self.grid)

    def extra_repr(self) -> str:
        return f"cluster={self.cluster}, grid={self.grid}"
