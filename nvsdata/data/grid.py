"""Assigning nodes of graphs to the cells of a grid (thesis 4.2.3, 5.2.3)."""

from __future__ import annotations

import math

import torch

Size = tuple[int, int]


def check_cluster(cluster: Size) -> None:
    """ValueError for clusters smaller than a pixel."""
    if min(cluster) < 1:
        raise ValueError(f"cluster must be (width, height) of at least 1 pixel, not {cluster}")


def grid_shape(sensor_size: Size, cluster: Size) -> Size:
    """Number of columns and rows of clusters that cover the sensor: the ceilings of section 4.2.3."""
    return math.ceil(sensor_size[0] / cluster[0]), math.ceil(sensor_size[1] / cluster[1])


def cells(pos: torch.Tensor, cluster: Size, grid: Size) -> torch.Tensor:
    """Cell of each node, row * columns + column: int64 [N]. Nodes outside go to the border cells; NaN counts as 0."""
    # NaN is not an integer: as an index it would make the GPU unusable for this process
    column = (pos[:, 0] / cluster[0]).floor().clamp(0, grid[0] - 1).nan_to_num(0).long()
    row = (pos[:, 1] / cluster[1]).floor().clamp(0, grid[1] - 1).nan_to_num(0).long()
    return row * grid[0] + column


def to_grid(
    x: torch.Tensor, pos: torch.Tensor, batch: torch.Tensor, graphs: int, volumes: int, cluster: Size, grid: Size
) -> torch.Tensor:
    """Features of nodes placed in their cells, (5.1): `x` [N, C] to [graphs / volumes, C, volumes, rows, columns].

    Cells without a node are 0; the features of nodes in the same cell are summed. Differentiable in `x`.
    """
    columns, rows = grid
    place = batch * (rows * columns) + cells(pos, cluster, grid)
    flat = x.new_zeros(graphs * rows * columns, x.shape[1]).index_add_(0, place, x)
    return flat.view(graphs // volumes, volumes, rows, columns, x.shape[1]).permute(0, 4, 1, 2, 3)
