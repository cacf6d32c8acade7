"""Graphs to grids, so that a dataset can return frames (thesis 5.2.3)."""

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
    """A graph, or a sequence of S graphs, to float32 [C, S, H, W], with C features per node (eq. 5.1).

    The features of a node go to the cell in which it lies; the features of nodes in one cell are added.

    - `cluster`: (width, height) of a cell in pixels (default 1, 1); H x W cells cover the sensor

    ValueError for no graph, graphs without `sensor_size`, or cells of less than a pixel.
    """

    cluster: tuple[int, int] = (1, 1)
    deterministic: ClassVar[bool] = True

    def __post_init__(self) -> None:
        check_cluster(self.cluster)

    def __call__(self, graphs: Graph | Sequence[Graph]) -> torch.Tensor:
        return graph2grid(graphs, self.cluster)


def graph2grid(graphs: Graph | Sequence[Graph], cluster: tuple[int, int] = (1, 1)) -> torch.Tensor:
    """Frames [C, S, H, W]; ValueError for no graph or one without `sensor_size`. See `Graph2Grid`."""
    sequence = [graphs] if isinstance(graphs, Graph) else sequence_of(graphs)
    batch = GraphBatch.from_graphs(sequence, volumes=len(sequence))
    if batch.sensor_size is None:
        raise ValueError("a graph without sensor_size has no grid")
    grid = grid_shape(batch.sensor_size, cluster)
    check_memory(batch.sensor_size, (batch.x.shape[1], len(sequence), grid[1], grid[0]))
    return to_grid(batch.x, batch.pos, batch.batch, len(sequence), len(sequence), cluster, grid)[0]
