"""Graph CNNs for objects, plain and residual (thesis, sections 4.2.5 and 4.4.2).

A node is one of its own neighbors, because its distance 0 is within the radius (thesis, eq. 4.2). In addition, it
has a root weight. Event graphs have many isolated nodes, which would contribute nothing otherwise. The fraction of the
mean that the node itself contributes shows how dense its neighborhood is.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Literal

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


@dataclass(frozen=True)
class Kernel:
    """Settings of a network's convolutions; see `RGCNN` for each."""

    size: int = 5
    dim: int = 2
    convolution: Convolution = "spline"
    loops: bool = True
    root_weight: bool = True

    def layer(self, in_channels: int, out_channels: int) -> nn.Module:
        """Return a convolution. ValueError for an unknown `convolution`."""
        made = self.convolution
        if made == "spline":
            return self.spline(in_channels, out_channels, self.size)
        if isinstance(made, str) and made in CONVOLUTIONS:
            return CONVOLUTIONS[made](in_channels, out_channels, self.size, self.dim)
        if isinstance(made, str) or not callable(made):
            names = ("spline", *CONVOLUTIONS)
            raise ValueError(f"convolution must be one of {names}, or a class of your own, not {made!r}")
        layer = made(in_channels, out_channels)
        if not isinstance(layer, nn.Module):
            raise ValueError(f"convolution must return a torch.nn.Module, not {layer!r:.100}")
        return layer

    def spline(self, in_channels: int, out_channels: int, size: int) -> SplineConv:
        """Return a B-spline convolution of kernel size `size`."""
        return SplineConv(in_channels, out_channels, kernel_size=size, dim=self.dim, root_weight=self.root_weight)

    def edges(self, batch: GraphBatch, convolution: nn.Module) -> tuple[torch.Tensor, torch.Tensor]:
        """Return the edges and pseudo-coordinates for a convolution, with self-loops for B-splines only."""
        if self.loops and isinstance(convolution, SplineConv):
            return add_self_loops(batch)
        return batch.edge_index, batch.edge_attr


Pooling = Literal["max", "average"]


class ConvBlock(nn.Module):
    """Graph convolution and batch normalization (thesis, eqs. 4.6, 4.7), without the activation that follows."""

    def __init__(self, in_channels: int, out_channels: int, kernel: Kernel) -> None:
        super().__init__()
        self.kernel = kernel
        self.conv = kernel.layer(in_channels, out_channels)
        self.norm = BatchNorm(out_channels)

    def forward(self, batch: GraphBatch) -> GraphBatch:
        """Return the same graphs with `x` [N, out_channels]."""
        return replace(batch, x=self.norm(self.conv(batch.x, *self.kernel.edges(batch, self.conv))))


class ResidualBlock(nn.Module):
    """Residual block of a graph CNN (Res_g, thesis, section 4.2.5), without the activation that follows.

    The output is the sum of a convolution and a shortcut of kernel size 1, each normalized. `shortcut_start` is the
    initial scale of the shortcut's normalization.
    """

    def __init__(self, in_channels: int, out_channels: int, kernel: Kernel, shortcut_start: float = 0.0) -> None:
        super().__init__()
        self.kernel = kernel
        self.conv = kernel.layer(in_channels, out_channels)
        self.norm = BatchNorm(out_channels)
        self.shortcut = kernel.spline(in_channels, out_channels, 1)
        self.shortcut_norm = BatchNorm(out_channels)
        nn.init.constant_(self.shortcut_norm.weight, shortcut_start)

    def forward(self, batch: GraphBatch) -> GraphBatch:
        """Return the same graphs with `x` [N, out_channels]."""
        edges = self.kernel.edges(batch, self.shortcut)
        own = edges if isinstance(self.conv, SplineConv) else self.kernel.edges(batch, self.conv)
        x = self.norm(self.conv(batch.x, *own)).add_(self.shortcut_norm(self.shortcut(batch.x, *edges)))
        return replace(batch, x=x)


class Activation(nn.Module):
    """ReLU on the features of a batch."""

    def forward(self, batch: GraphBatch) -> GraphBatch:
        """Return the same graphs with negative values in `x` set to 0."""
        return replace(batch, x=torch.relu(batch.x))


def activated_pool(cluster: Size, sensor_size: Size, pooling: Pooling) -> list[nn.Module]:
    """Return the activation of a block and the pooling after it (thesis, eqs. 4.6, 4.9), as two layers.

    For the maximum, ReLU comes after pooling: the result is the same, and there are fewer nodes to compute. For an
    average, ReLU comes before.
    """
    pool, activation = GraphPool(cluster, sensor_size, pooling), Activation()
    return [pool, activation] if pooling == "max" else [activation, pool]


def check_pairs(channels: Sequence[int], clusters: Sequence[Size | None]) -> None:
    """Raise ValueError unless `channels` and `clusters` have equal lengths of at least 1."""
    if len(channels) != len(clusters) or not channels:
        raise ValueError(
            f"channels and clusters must have equal lengths of at least 1, not {len(channels)} and {len(clusters)}"
        )


def input_of(network: Any, graphs: Graph | Data) -> GraphBatch:
    """Return graphs as a batch, with features of the network's precision.

    ValueError for graphs of a larger sensor than the network's, or with another number of features or
    pseudo-coordinates.
    """
    batch, sensor_size = GraphBatch.of(graphs), network.sensor_size
    if batch.sensor_size is not None and (
        batch.sensor_size[0] > sensor_size[0] or batch.sensor_size[1] > sensor_size[1]
    ):
        given, expected = ("x".join(map(str, size)) for size in (batch.sensor_size, sensor_size))
        raise ValueError(f"graphs of a sensor of {given}, but the network is for {expected}")
    if batch.x.shape[1] != network.in_channels:
        raise ValueError(f"nodes have {batch.x.shape[1]} features, but the network takes {network.in_channels}")
    if (axes := batch.edge_attr.shape[1]) != network.dim:
        what = f"edges have {axes} pseudo-coordinates ({batch.pseudo!r})"
        raise ValueError(f"{what}, but the network takes {network.dim}: build it with dim={axes}")
    return replace(batch, x=batch.x.to(network.classify.weight.dtype))


class _GraphCNN(nn.Module):
    """Sequence of layers Conv -> MaxP -> (block -> MaxP) x L -> FC -> FC."""

    residual: bool

    def __init__(
        self,
        num_classes: int,
        *,
        sensor_size: Size = (34, 34),
        channels: Sequence[int] = (32, 64, 128),
        clusters: Sequence[Size | None] = ((2, 2), (4, 4), (7, 7)),
        hidden: int = 128,
        kernel_size: int = 5,
        in_channels: int = 1,
        dim: int = 2,
        dropout: float = 0.5,
        convolution: Convolution = "spline",
        pooling: Pooling = "max",
        loops: bool = True,
        root_weight: bool = True,
        shortcut_start: float = 0.0,
    ) -> None:
        super().__init__()
        check_pairs(channels, clusters)
        kernel = Kernel(kernel_size, dim, convolution, loops, root_weight)
        self.sensor_size, self.in_channels, self.dim = sensor_size, in_channels, dim
        layers: list[nn.Module] = []
        previous = in_channels
        for depth, (width, cluster) in enumerate(zip(channels, clusters, strict=True)):
            if self.residual and depth > 0:
                layers.append(ResidualBlock(previous, width, kernel, shortcut_start))
            else:
                layers.append(ConvBlock(previous, width, kernel))
            # nodes are these clusters already, so pooling would merge none
            if cluster is None or (depth > 0 and cluster == clusters[depth - 1]):
                layers.append(Activation())
            else:
                layers += activated_pool(cluster, sensor_size, pooling)
            previous = width
        last = clusters[-1]
        if last is None:
            raise ValueError("the last entry of clusters can't be None: it is the grid of the fully connected layer")
        self.features = nn.Sequential(*layers)
        self.cluster, self.grid = last, grid_shape(sensor_size, last)
        self.hidden = nn.Linear(self.grid[0] * self.grid[1] * previous, hidden)
        self.dropout = Dropout(dropout)
        self.classify = nn.Linear(hidden, num_classes)

    def forward(self, graphs: Graph | Data) -> torch.Tensor:
        """Return class scores (logits) [B, num_classes] of a batch of graphs, or of one graph (B = 1).

        ValueError for graphs of a larger sensor or with another number of features, TypeError for inputs that aren't
        graphs.
        """
        batch = self.features(input_of(self, graphs))
        # one weight per cell and channel (eq. 4.10); a cell without a node adds nothing
        total = self.grid[0] * self.grid[1]
        place = batch.batch * total + cells(batch.pos, self.cluster, self.grid)
        flat = batch.x.new_zeros(batch.num_graphs * total, batch.x.shape[1]).index_copy_(0, place, batch.x)
        x = torch.relu(self.hidden(flat.view(batch.num_graphs, -1)))
        scores: torch.Tensor = self.classify(self.dropout(x))
        return scores


@register_network("rgcnn")
class RGCNN(_GraphCNN):
    """Residual graph CNN (thesis, section 4.2.5): Conv -> MaxP -> (Res_g -> MaxP) x L -> FC(hidden) -> FC(num_classes).

    The network takes a `Graph` or `GraphBatch`, or PyTorch Geometric's `Data` or `Batch` (see `Graph.from_pyg`), with
    `x` [N, in_channels]. It returns class scores (logits) [B, num_classes].

    Args:
        num_classes: Number of scores.
        sensor_size: (width, height) in pixels (default (34, 34)).
        channels: Output channels of each of the L + 1 blocks (default (32, 64, 128)).
        clusters: (width, height) in pixels of the clusters of each of the L + 1 poolings (default (2, 2), (4, 4),
            (7, 7)). A block isn't pooled if its entry is None or equals that of the block before. The last entry can't
            be None.
        hidden: Width of the hidden fully connected layer (default 128).
        kernel_size: Cells of the B-spline kernels along each axis (default 5).
        in_channels: Features per node (default 1).
        dim: Pseudo-coordinates per edge: 2 (default), or 3 with time.
        dropout: Probability of dropout before the last layer (default 0.5).
        convolution: "spline" (default); "gcn", "cheb", "monet" or "gin" for comparison (thesis, Table 4.8, with
            `GCNN`); or a class or function of your own that takes (in_channels, out_channels) and returns a module. The
            module's `forward(x, edge_index, edge_attr)` takes [N, in_channels], int64 [2, E] (source, target) without
            self-loops and pseudo-coordinates [E, dim], and returns [N, out_channels]. Shortcuts of residual blocks are
            always B-splines.
        pooling: "max" (default; MaxP, as in all networks of the thesis) or "average" (AvgP) of the features of a
            cluster (thesis, eq. 4.9).
        loops: True (default) if a node is one of its own neighbors in B-spline convolutions.
        root_weight: True (default) if B-spline convolutions add a node's own features, multiplied by a separate matrix.
        shortcut_start: Initial scale of a shortcut's normalization (default 0.0: the network starts as the plain one
            and learns to use its shortcuts).

    Raises:
        ValueError: For settings that don't fit together, graphs of a larger sensor, or another number of features.

    Example:
        >>> import nvsdata
        >>> from nvsdata import models, transforms as T
        >>> graph = T.RadiusGraph()(nvsdata.Events([0, 9], [1, 2], [0, 1], [1, 0], (34, 34)))
        >>> models.RGCNN(10).eval()(graph).shape
        torch.Size([1, 10])
    """

    residual = True


@register_network("gcnn")
class GCNN(_GraphCNN):
    """Plain graph CNN (thesis, section 4.4.2): Conv -> MaxP -> (Conv -> MaxP) x L -> FC(hidden) -> FC(num_classes).

    The plain counterpart of `RGCNN` has a convolution with ReLU in place of each residual block. Arguments, input,
    output and errors are those of `RGCNN`; `shortcut_start` has no effect.

    Example:
        >>> import nvsdata
        >>> from nvsdata import models, transforms as T
        >>> graph = T.RadiusGraph()(nvsdata.Events([0, 9], [1, 2], [0, 1], [1, 0], (34, 34)))
        >>> models.GCNN(10, convolution="gcn").eval()(graph).shape
        torch.Size([1, 10])
    """

    residual = False
