"""Grids over a sensor, to whose cells nodes of graphs are assigned (thesis, sections 4.2.3 and 5.2.3)."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import torch

Size = tuple[int, int]


def check_cluster(cluster: Size) -> None:
    """Raise ValueError for clusters smaller than a pixel."""
    if min(cluster) < 1:
        raise ValueError(f"cluster must be (width, height) of at least 1 pixel, not {cluster}")


def grid_shape(sensor_size: Size, cluster: Size) -> Size:
    """Return the number of columns and rows of clusters that cover the sensor (thesis, section 4.2.3)."""
    return math.ceil(sensor_size[0] / cluster[0]), math.ceil(sensor_size[1] / cluster[1])


def cells(pos: torch.Tensor, cluster: Size, grid: Size) -> torch.Tensor:
    """Return the cell of each node, row * columns + column, int64 [N].

    Nodes outside the grid are in the nearest border cells. A coordinate of NaN counts as 0.
    """
    # NaN as an index would make the GPU unusable for this process
    column = (pos[:, 0] / cluster[0]).floor().clamp(0, grid[0] - 1).nan_to_num(0).long()
    row = (pos[:, 1] / cluster[1]).floor().clamp(0, grid[1] - 1).nan_to_num(0).long()
    return row * grid[0] + column


def to_grid(
    x: torch.Tensor, pos: torch.Tensor, batch: torch.Tensor, graphs: int, volumes: int, cluster: Size, grid: Size
) -> torch.Tensor:
    """Place features of nodes in their cells (thesis eq. 5.1), differentiably in `x`.

    Args:
        x: Features [N, C].
        pos: Positions of nodes in pixels, [N, 2].
        batch: Number of each node's graph, int64 [N].
        graphs: Number of graphs in the batch.
        volumes: Number of graphs of each sample.
        cluster: (width, height) of a cell in pixels.
        grid: (columns, rows), as `grid_shape` returns.

    Returns:
        [graphs / volumes, C, volumes, rows, columns]. Cells without nodes are 0; the features of nodes in one cell
        are summed.
    """
    columns, rows = grid
    place = batch * (rows * columns) + cells(pos, cluster, grid)
    flat = x.new_zeros(graphs * rows * columns, x.shape[1]).index_add_(0, place, x)
    return flat.view(graphs // volumes, volumes, rows, columns, x.shape[1]).permute(0, 4, 1, 2, 3)
