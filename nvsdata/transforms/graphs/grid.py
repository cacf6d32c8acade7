"""Graphs to grids, so that a dataset can return frames (thesis, section 5.2.3)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import torch

from nvsdata.common.memory import check_memory
from nvsdata.data.graph import Graph, GraphBatch, sequence_of
from nvsdata.data.grid import check_cluster, grid_shape, to_grid


@dataclass(frozen=True)
class Graph2Grid:
    """Sum the features of the nodes in each cell of the sensor (thesis, equation 5.1).

    Args:
        cluster: (width, height) of a cell in pixels (default 1, 1).

    Returns:
        float32 [C, S, H, W], where H x W cells cover the sensor. The call takes a graph (S = 1) or a sequence of S
        graphs, with C features per node.

    Raises:
        ValueError: There is no graph, a graph has no `sensor_size`, or cells are smaller than a pixel.

    Example:
        >>> from nvsdata import Events, transforms as T
        >>> graph = T.RadiusGraph()(Events([0, 5, 10], [1, 2, 3], [1, 1, 1], [1, 0, 1], (8, 6)))
        >>> T.Graph2Grid((2, 2))([graph, graph]).shape
        torch.Size([1, 2, 3, 4])
    """

    cluster: tuple[int, int] = (1, 1)
    deterministic: ClassVar[bool] = True

    def __post_init__(self) -> None:
        check_cluster(self.cluster)

    def __call__(self, graphs: Graph | Sequence[Graph]) -> torch.Tensor:
        sequence = [graphs] if isinstance(graphs, Graph) else sequence_of(graphs)
        batch = GraphBatch.from_graphs(sequence, volumes=len(sequence))
        if batch.sensor_size is None:
            raise ValueError("a graph without sensor_size has no grid")
        grid = grid_shape(batch.sensor_size, self.cluster)
        check_memory(batch.sensor_size, (batch.x.shape[1], len(sequence), grid[1], grid[0]))
        return to_grid(batch.x, batch.pos, batch.batch, len(sequence), len(sequence), self.cluster, grid)[0]
