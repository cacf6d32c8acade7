"""Graph2Grid in a network (thesis 5.2.3)."""

from __future__ import annotations

import torch
from torch import nn

from nvsdata.data.graph import Graph, GraphBatch
from nvsdata.data.grid import check_cluster, grid_shape, to_grid


class Graph2Grid(nn.Module):
    """Graphs to frames, (5.1): a batch of sequences of S graphs to [B, C, S, H, W], C features a node.

    A node goes to the cell of `cluster` = (width, height) pixels that it lies in, which after a `GraphPool` of
    that cluster no other does; H x W cells cover the sensor (30 x 30 for 240x180 and (8, 6)). Empty cells,
    and graphs without nodes, are 0. Differentiable.
    """

    def __init__(self, cluster: tuple[int, int], sensor_size: tuple[int, int]) -> None:
        super().__init__()
        check_cluster(cluster)
        self.cluster = cluster
        self.grid = grid_shape(sensor_size, cluster)

    def forward(self, graphs: Graph | GraphBatch) -> torch.Tensor:
        """Frames [B, C, S, H, W]; one graph is a batch of one sequence of one."""
        batch = GraphBatch.of(graphs)
        return to_grid(batch.x, batch.pos, batch.batch, batch.num_graphs, batch.volumes, self.cluster, self.grid)

    def extra_repr(self) -> str:
        return f"cluster={self.cluster}, grid={self.grid}"
