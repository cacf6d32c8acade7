"""Graph pooling over rectangular clusters (thesis, eqs. 4.8, 4.9)."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

from torch import nn

from nvsdata.data.graph import GraphBatch
from nvsdata.data.grid import check_cluster, grid_shape
from nvsdata.data.pseudo import Reach, pseudo
from nvsdata.models.clusters import pooled_rows, structure


class GraphPool(nn.Module):
    """Graph pooling, which merges the nodes of each cluster of pixels into one node.

    The layer takes and returns a `GraphBatch`. The position of a new node is the floor of the mean position of the
    merged nodes (thesis, eq. 4.8). Its features are their maximum or mean (thesis, eq. 4.9). Its `t` is their mean
    time, rounded down. There is one edge from a cluster to another if there is any edge from a node of the first to a
    node of the second. The normalization range of pseudo-coordinates is that of `coarse_reach`; longer edges are
    clipped to it.

    Args:
        cluster: (width, height) of a cluster in pixels.
        sensor_size: (width, height) in pixels.
        mode: "max" (default) or "average" of the features.

    Raises:
        ValueError: For an unknown mode, and clusters smaller than a pixel.

    Example:
        >>> import nvsdata
        >>> from nvsdata import models, transforms as T
        >>> graph = T.RadiusGraph()(nvsdata.Events([0, 9], [2, 3], [0, 1], [1, 0], (34, 34)))
        >>> batch = nvsdata.GraphBatch.from_graphs([graph])
        >>> models.GraphPool((2, 2), (34, 34))(batch).num_nodes
        1
    """

    def __init__(
        self, cluster: tuple[int, int], sensor_size: tuple[int, int], mode: Literal["max", "average"] = "max"
    ) -> None:
        super().__init__()
        check_cluster(cluster)
        if mode not in ("max", "average"):
            raise ValueError(f"pooling mode must be 'max' or 'average', not {mode!r}")
        self.cluster, self.mode = cluster, mode
        self.grid = grid_shape(sensor_size, cluster)

    def forward(self, batch: GraphBatch) -> GraphBatch:
        """Pool a batch; graphs without nodes remain without nodes."""
        cluster, pos, t, graph, ptr, edges = structure(batch, self.cluster, self.grid)
        x = pooled_rows(batch.x, cluster, pos.shape[0], self.mode)
        reach = coarse_reach(batch.reach, self.cluster)
        return replace(
            batch,
            x=x,
            pos=pos,
            t=t,
            edge_index=edges,
            edge_attr=pseudo(pos, t, edges, reach, batch.pseudo),
            reach=reach,
            batch=graph,
            ptr=ptr,
        )

    def extra_repr(self) -> str:
        return f"cluster={self.cluster}, mode={self.mode!r}"


def coarse_reach(reach: Reach, cluster: tuple[int, int]) -> Reach:
    """Return the normalization range of the pseudo-coordinates after pooling.

    Along each axis in space, it is the side of a cluster, or the range before pooling if that is larger. On N-MNIST, 92
    to 100% of the edges are within this range.
    """
    return max(reach[0], cluster[0]), max(reach[1], cluster[1]), *reach[2:]
