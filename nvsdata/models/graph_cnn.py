"""Graph CNNs for objects, plain and residual (thesis 4.2.5 and 4.4.2).

A node is one of its own neighbors (its distance, 0, is within the radius of eq. 4.2) and also has a root weight:
event graphs have many isolated nodes, which would contribute nothing otherwise, and the node's share of the mean
shows how dense its neighborhood is.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Literal

import torch
from torch import nn

from nvsdata.data.graph import Graph, GraphBatch
from nvsdata.data.grid import cells, grid_shape
from nvsdata.models.conv import CONVOLUTIONS
from nvsdata.models.distributed import Dropout
from nvsdata.models.norm import BatchNorm
from nvsdata.models.pool import GraphPool
from nvsdata.models.registry import register_network
from nvsdata.models.spline import SplineConv, add_self_loops

if TYPE_CHECKING:
    from torch_geometric.data import Data

Size = tuple[int, int]
Convolution = str | Callable[[int, int], nn.Module]


def convolution_layer(
    convolution: Convolution, in_channels: int, out_channels: int, kernel_size: int, dim: int
) -> nn.Module:
    """The layer that a `convolution` of `RGCNN` or `GCNN` stands for. ValueError if it stands for none."""
    if convolution == "spline":
        return SplineConv(in_channels, out_channels, kernel_size=kernel_size, dim=dim, root_weight=True)
    if isinstance(convolution, str) and convolution in CONVOLUTIONS:
        return CONVOLUTIONS[convolution](in_channels, out_channels, kernel_size, dim)
    if isinstance(convolution, str) or not callable(convolution):
        names = ("spline", *CONVOLUTIONS)
        raise ValueError(f"convolution must be one of {names}, or a class of your own, not {convolution!r}")
    layer = convolution(in_channels, out_channels)
    if not isinstance(layer, nn.Module):
        raise ValueError(f"convolution must give a torch.nn.Module, not {layer!r:.100}")
    return layer


Pooling = Literal["max", "average"]


class ConvBlock(nn.Module):
    """Graph convolution and batch normalization (thesis eqs. 4.6, 4.7), without the activation that follows.

    `convolution` is "spline", or another of `GCNN`; those handle the node itself in their own way.
    """

    def __init__(
        self, in_channels: int, out_channels: int, kernel_size: int, dim: int = 2, convolution: Convolution = "spline"
    ) -> None:
        super().__init__()
        self.loops = convolution == "spline"
        self.conv = convolution_layer(convolution, in_channels, out_channels, kernel_size, dim)
        self.norm = BatchNorm(out_channels)

    def forward(self, batch: GraphBatch) -> GraphBatch:
        """The same graphs with `x` [N, out_channels]."""
        edges = add_self_loops(batch) if self.loops else (batch.edge_index, batch.edge_attr)
        return replace(batch, x=self.norm(self.conv(batch.x, *edges)))


class ResidualBlock(nn.Module):
    """Res_g (thesis 4.2.5), without the activation that follows.

    The sum of a convolution and a shortcut of kernel size 1, each normalized. The scale of the shortcut's
    normalization starts at 0, so the network starts as the plain one and learns to use its shortcuts.
    """

    def __init__(
        self, in_channels: int, out_channels: int, kernel_size: int, dim: int = 2, convolution: Convolution = "spline"
    ) -> None:
        super().__init__()
        self.loops = convolution == "spline"
        self.conv = convolution_layer(convolution, in_channels, out_channels, kernel_size, dim)
        self.norm = BatchNorm(out_channels)
        self.shortcut = SplineConv(in_channels, out_channels, kernel_size=1, dim=dim, root_weight=True)
        self.shortcut_norm = BatchNorm(out_channels)
        nn.init.zeros_(self.shortcut_norm.weight)

    def forward(self, batch: GraphBatch) -> GraphBatch:
        """The same graphs with `x` [N, out_channels]."""
        edges = add_self_loops(batch)
        x = self.norm(self.conv(batch.x, *(edges if self.loops else (batch.edge_index, batch.edge_attr))))
        x = x.add_(self.shortcut_norm(self.shortcut(batch.x, *edges)))
        return replace(batch, x=x)


class Activation(nn.Module):
    """ReLU on the features of a batch."""

    def forward(self, batch: GraphBatch) -> GraphBatch:
        """The same graphs with negative values in `x` set to 0."""
        return replace(batch, x=torch.relu(batch.x))


def activated_pool(cluster: Size, sensor_size: Size, pooling: Pooling) -> list[nn.Module]:
    """The activation of a block and the pooling after it (eqs. 4.6, 4.9), as two layers.

    Maximum and ReLU can be swapped, and there are fewer nodes after pooling; of an average the order matters.
    """
    pool, activation = GraphPool(cluster, sensor_size, pooling), Activation()
    return [pool, activation] if pooling == "max" else [activation, pool]


def check_pairs(channels: Sequence[int], clusters: Sequence[Size]) -> None:
    """ValueError unless there is one cluster for each number of channels, and at least one."""
    if len(channels) != len(clusters) or not channels:
        raise ValueError(f"channels and clusters must pair up, not {len(channels)} and {len(clusters)}")


def check_input(batch: GraphBatch, sensor_size: Size, in_channels: int, dim: int) -> None:
    """ValueError for graphs of a larger sensor than the network's, or of other numbers of features or dimensions."""
    if batch.sensor_size is not None and (
        batch.sensor_size[0] > sensor_size[0] or batch.sensor_size[1] > sensor_size[1]
    ):
        given, expected = ("x".join(map(str, size)) for size in (batch.sensor_size, sensor_size))
        raise ValueError(f"graphs of a sensor of {given}, but the network is for {expected}")
    if batch.x.shape[1] != in_channels:
        raise ValueError(f"nodes have {batch.x.shape[1]} features, but the network takes {in_channels}")
    if (axes := batch.edge_attr.shape[1]) != dim:
        what = f"edges have {axes} pseudo-coordinates ({batch.pseudo!r})"
        raise ValueError(f"{what}, but the network takes {dim}: build it with dim={axes}")


class _GraphCNN(nn.Module):
    """Conv -> MaxP -> (block -> MaxP) x L -> FC -> FC."""

    residual: bool

    def __init__(
        self,
        num_classes: int,
        *,
        sensor_size: Size = (34, 34),
        channels: Sequence[int] = (32, 64, 128),
        clusters: Sequence[Size] = ((2, 2), (4, 4), (7, 7)),
        hidden: int = 128,
        kernel_size: int = 5,
        in_channels: int = 1,
        dim: int = 2,
        dropout: float = 0.5,
        convolution: Convolution = "spline",
        pooling: Pooling = "max",
    ) -> None:
        super().__init__()
        check_pairs(channels, clusters)
        self.sensor_size, self.in_channels, self.dim = sensor_size, in_channels, dim
        layers: list[nn.Module] = []
        previous = in_channels
        for depth, (width, cluster) in enumerate(zip(channels, clusters, strict=True)):
            block = ResidualBlock if self.residual and depth > 0 else ConvBlock
            layers.append(block(previous, width, kernel_size, dim, convolution))
            layers += activated_pool(cluster, sensor_size, pooling)
            previous = width
        self.features = nn.Sequential(*layers)
        self.cluster, self.grid = clusters[-1], grid_shape(sensor_size, clusters[-1])
        self.hidden = nn.Linear(self.grid[0] * self.grid[1] * previous, hidden)
        self.dropout = Dropout(dropout)
        self.classify = nn.Linear(hidden, num_classes)

    def forward(self, graphs: Graph | Data) -> torch.Tensor:
        """Class scores (logits) [B, num_classes] of a batch of graphs, or of one graph (B = 1).

        ValueError for graphs of a larger sensor, or with another number of features; TypeError for no graphs.
        """
        batch = GraphBatch.of(graphs)
        check_input(batch, self.sensor_size, self.in_channels, self.dim)
        batch = self.features(batch)
        # one weight per cell and channel (eq. 4.10); a cell without a node adds nothing
        total = self.grid[0] * self.grid[1]
        place = batch.batch * total + cells(batch.pos, self.cluster, self.grid)
        flat = batch.x.new_zeros(batch.num_graphs * total, batch.x.shape[1]).index_copy_(0, place, batch.x)
        x = torch.relu(self.hidden(flat.view(batch.num_graphs, -1)))
        scores: torch.Tensor = self.classify(self.dropout(x))
        return scores


@register_network("rgcnn")
class RGCNN(_GraphCNN):
    """Residual graph CNN (thesis 4.2.5): Conv -> MaxP -> (Res_g -> MaxP) x L -> FC(hidden) -> FC(num_classes).

    - `num_classes`: number of scores
    - `sensor_size`: (width, height) in pixels (default 34, 34)
    - `channels`: output channels of each of the L + 1 blocks (default 32, 64, 128)
    - `clusters`: (width, height) in pixels of the clusters of each of the L + 1 poolings (default (2, 2), (4, 4),
      (7, 7))
    - `hidden`: width of the hidden fully connected layer (default 128)
    - `kernel_size`: of the B-spline kernels, along each axis (default 5)
    - `in_channels`: features per node (default 1)
    - `dim`: pseudo-coordinates per edge, 2 (default), or 3 with time
    - `dropout`: probability before the last layer (default 0.5)
    - `convolution`: "spline" (default); "gcn", "cheb", "monet" or "gin" for comparison (thesis Table 4.8, of `GCNN`);
      or your own: a class, or a function, of (in_channels, out_channels) that gives a module. Its
      `forward(x, edge_index, edge_attr)` takes [N, in_channels], int64 [2, E] (source, target) without self-loops and
      pseudo-coordinates [E, dim], and gives [N, out_channels]. Shortcuts of residual blocks are B-splines always
    - `pooling`: "max" (default; MaxP, as in all of the thesis's networks) or "average" (AvgP) of a cluster's features
      (eq. 4.9)

    Takes a `Graph` or `GraphBatch`, or PyTorch Geometric's `Data` or `Batch` (see `Graph.from_pyg`), with `x`
    [N, in_channels]; gives class scores (logits) [B, num_classes].
    ValueError for settings that don't fit together, graphs of a larger sensor, or another number of features.
    """

    residual = True


@register_network("gcnn")
class GCNN(_GraphCNN):
    """The plain counterpart of `RGCNN`: a convolution with ReLU in place of each residual block.

    - parameters, input, output and errors: those of `RGCNN`
    """

    residual = False
