"""Events to graphs: edges between events that are close to each other."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
import torch

from nvsdata.common.validation import not_negative, positive, whole
from nvsdata.data.events import Events
from nvsdata.data.graph import Graph, GraphBatch
from nvsdata.data.pseudo import Pseudo, Reach, check_pseudo, pseudo
from nvsdata.data.recording import Recording, as_events, wrong_type
from nvsdata.kernels.decode.order import is_sorted
from nvsdata.kernels.graph.edges import event_graph
from nvsdata.kernels.graph.neighbors import near_edges
from nvsdata.kernels.streaming.earlier import earlier_edges
from nvsdata.transforms.events.sampling import BETA
from nvsdata.transforms.graphs.on_gpu import graphs_on_gpu

PSEUDO: Pseudo = "signed"  # as in the author's code; the thesis (section 4.2.1) has "abs"
REACH_T = 15_000  # µs between the nodes of an edge; few edges in windows of 30 ms are longer
SHORTEST = float(np.finfo(np.float32).tiny)  # smallest normalization range: smaller ones are 0 in float32
LARGEST = 2**26  # pixels of the rectangle around the nodes of a causal graph
FURTHEST = 32_767  # largest distance of nodes along an axis in pixels, as for events

Limits = tuple[float, float, float, int]
"""Radius, alpha, beta and largest degree."""


@dataclass(frozen=True)
class RadiusGraph:
    """Connect events that are close in space and time (radius graph; thesis, equation 4.2).

    Two events are connected, in both directions, if sqrt(alpha (dx² + dy²) + beta dt²) <= radius, with dx and dy in
    pixels and dt in µs. Each node keeps the edges from its `max_degree` nearest neighbors: by this distance, at equal
    distances by time, then by index. Time differences are computed in int64, so any time offset gives the same graph.

    Args:
        radius: Largest distance (default 3.0).
        alpha: Weight of squared pixels (default 1.0).
        beta: Weight of squared µs (default (0.5e-5)²). The default is that of the author's graphs, where time is scaled
            by 0.5e-5 per µs and then squared: neighbors are near in space, at any time of the window. The value
            printed in the thesis is 0.5e-5: then 1.3 ms count as much as 3 pixels, and most nodes have no neighbor.
        max_degree: Largest number of edges that end in a node (default 32).
        pseudo: Kind of pseudo-coordinates: "abs" (as in the thesis) has |dx| and |dy|, "signed" (default, as in the
            author's code) dx and dy, "signed-time" also dt.
        reach_t: Normalization range of the time axis of "signed-time" in µs (default 15,000, which 90% of the edges in
            windows of 30 ms don't exceed).
        causal: True for edges from earlier events to later ones only, so that later events don't change a node
            (default False). Of events at equal times, the one with the smaller index counts as earlier.

    Returns:
        A `Graph` with one node per event in the same order, and polarity ±1 as its feature. The call takes `Events`, a
        `Recording`, or a `Graph`, such as that of `MergePixels`, whose nodes get new edges.

    Raises:
        ValueError: A setting is out of range.

    Example:
        >>> from nvsdata import Events, transforms as T
        >>> events = Events([0, 10, 30], [1, 2, 7], [1, 1, 7], [1, 0, 1], (8, 8))
        >>> T.RadiusGraph(radius=3.0)(events).edge_index.tolist()
        [[1, 0], [0, 1]]
    """

    radius: float = 3.0
    alpha: float = 1.0
    beta: float = BETA
    max_degree: int = 32
    pseudo: Pseudo = PSEUDO
    reach_t: int = REACH_T
    causal: bool = False
    deterministic: ClassVar[bool] = True

    def __post_init__(self) -> None:
        positive("radius", self.radius)
        not_negative("alpha", self.alpha)
        not_negative("beta", self.beta)
        whole("max_degree", self.max_degree, 1)
        check_pseudo(self.pseudo)
        positive("reach_t", self.reach_t)
        if self.causal and self.alpha == 0:
            raise ValueError("a causal graph needs alpha above 0")

    def __call__(self, sample: Events | Recording | Graph) -> Graph:
        if not isinstance(sample, Graph):
            sample = as_events(sample)
        reach = self.reach(sample.sensor_size or (1, 1))
        if self.causal:
            nodes = sample if isinstance(sample, Graph) else _nodes(sample)
            return _joined_nodes(nodes, self._earlier, reach, self.pseudo)
        return _joined(sample, self._limits(), reach, self.pseudo)

    def batch(self, samples: Sequence[Events | Recording], device: torch.device | str = "cpu") -> GraphBatch:
        """Return the graphs of several recordings as a batch on a device.

        On a GPU with Triton, 7 bytes per event are copied to the GPU, which builds the graphs. Otherwise the CPU builds
        them. It also builds `causal` graphs, graphs with `alpha` = 0 or a radius above about 8 pixels, and graphs of
        events beyond 4096 x 2048 pixels or 71 minutes. The graphs are the same.

        Args:
            samples: Events of each graph.
            device: The device (default "cpu").

        Returns:
            A `GraphBatch` without labels.

        Raises:
            ValueError: There are no samples.

        Example:
            >>> from nvsdata import Events, transforms as T
            >>> events = Events([0, 10, 30], [1, 2, 7], [1, 1, 7], [1, 0, 1], (8, 8))
            >>> T.RadiusGraph().batch([events, events])
            GraphBatch(2 graphs, 6 nodes, 4 edges)
        """
        events, device = [as_events(sample) for sample in samples], torch.device(device)
        made = None
        if not self.causal:
            made = graphs_on_gpu(events, device, self._limits(), self.reach((1, 1)), self.pseudo)
        return GraphBatch.from_graphs([self(one) for one in events]).to(device) if made is None else made

    def _limits(self) -> Limits:
        return float(self.radius), float(self.alpha), float(self.beta), int(self.max_degree)

    def _earlier(self, t: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Return the edges from earlier nodes to later ones."""
        width, height = int(x.max(initial=0)) + 1, int(y.max(initial=0)) + 1
        if width * height > LARGEST:
            raise ValueError(f"nodes of a causal graph must be within {LARGEST:,} pixels, not {width}x{height}")
        metric = float(self.radius), float(self.alpha), float(self.beta)
        return earlier_edges(t, x, y, (width, height), metric, int(self.max_degree))

    def reach(self, sensor_size: tuple[int, int]) -> Reach:
        """Return the normalization ranges of the pseudo-coordinates, in pixels and µs.

        Args:
            sensor_size: (width, height) in pixels, the range in space if `alpha` is 0.
        """
        side = self.radius / math.sqrt(self.alpha) if self.alpha > 0 else 0.0
        wide, high = (side, side) if side else sensor_size
        space = max(float(wide), SHORTEST), max(float(high), SHORTEST)
        return (*space, max(float(self.reach_t), SHORTEST)) if self.pseudo == "signed-time" else space


@dataclass(frozen=True)
class KNNGraph:
    """Connect each event with its `k` nearest neighbors in space, by edges to the event (thesis, section 5.3.1).

    At equal distances the neighbor nearer in time comes first, then that of smaller index. An event has fewer edges
    only if there are no more than `k` events.

    Args:
        k: Number of neighbors of an event (default 1).
        reach: Normalization range of the pseudo-coordinates in pixels (default 8.0); longer edges are clipped to it. In
            the dense graphs among those that the thesis's author released, 99% of the edges are shorter.
        pseudo: See `RadiusGraph`.
        reach_t: See `RadiusGraph`.

    Returns:
        A `Graph`. The call takes `Events`, a `Recording` or a `Graph`; see `RadiusGraph`.

    Raises:
        ValueError: A setting is out of range.

    Example:
        >>> from nvsdata import Events, transforms as T
        >>> events = Events([0, 10, 30], [1, 2, 7], [1, 1, 7], [1, 0, 1], (8, 8))
        >>> T.KNNGraph(1)(events).edge_index.tolist()
        [[1, 0, 1], [0, 1, 2]]
    """

    k: int = 1
    reach: float = 8.0
    pseudo: Pseudo = PSEUDO
    reach_t: int = REACH_T
    deterministic: ClassVar[bool] = True

    def __post_init__(self) -> None:
        whole("k", self.k, 1)
        positive("reach", self.reach)
        check_pseudo(self.pseudo)
        positive("reach_t", self.reach_t)

    def __call__(self, sample: Events | Recording | Graph) -> Graph:
        if not isinstance(sample, Graph):
            sample = as_events(sample)
        space = (max(float(self.reach), SHORTEST),) * 2
        reach = (*space, max(float(self.reach_t), SHORTEST)) if self.pseudo == "signed-time" else space
        return _joined(sample, (math.inf, 1.0, 0.0, int(self.k)), reach, self.pseudo)


def _joined(sample: Events | Graph, limits: Limits, reach: Reach, kind: Pseudo) -> Graph:
    if isinstance(sample, Graph):
        return _joined_nodes(sample, lambda t, x, y: near_edges(t, x, y, *limits), reach, kind)
    arrays = event_graph(sample.t, sample.x, sample.y, sample.p, sample.start, *limits, reach, kind != "abs")
    x, pos, t, edge_index, edge_attr = map(torch.from_numpy, arrays)
    return Graph(x, pos, t, edge_index, edge_attr, None, sample.sensor_size, reach, kind)


Near = Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]


def _nodes(events: Events) -> Graph:
    """Return events as a graph without edges."""
    x = torch.from_numpy(2 * events.p.astype(np.float32) - 1)[:, None]
    pos = torch.from_numpy(np.stack((events.x, events.y), 1).astype(np.float32))
    none = torch.empty((2, 0), dtype=torch.int64)
    return Graph(x, pos, torch.from_numpy(events.t - events.start), none, torch.empty(0, 2), None, events.sensor_size)


def _joined_nodes(graph: Graph, near: Near, reach: Reach, kind: Pseudo) -> Graph:
    """Return the same nodes with new edges. For distances, the position of a node is rounded to the nearest pixel.

    Args:
        graph: The nodes.
        near: Function that returns edges int64 [2, E] for t, x and y in order of time.
        reach: Normalization ranges of the pseudo-coordinates.
        kind: Kind of pseudo-coordinates.
    """
    if isinstance(graph, GraphBatch):
        raise wrong_type("sample", "Events, a Recording or a single graph", graph)
    order = np.argsort(graph.t.numpy(), kind="stable")
    pixels = np.rint(graph.pos.numpy()[order])
    with np.errstate(invalid="ignore"):
        # the kernel needs coordinates from 0 on
        pixels -= pixels.min(0, initial=np.inf)
    if not (pixels <= FURTHEST).all():
        raise ValueError(f"nodes must be at finite positions, at most {FURTHEST} pixels apart along an axis")
    x, y = pixels.T.astype(np.int32)
    edges = near(graph.t.numpy()[order], x, y)
    if not is_sorted(order):
        # by target again, because the nodes weren't in order of time
        edges = order[edges]
        edges = edges[:, np.lexsort(edges)]
    edge_index = torch.from_numpy(edges)
    edge_attr = pseudo(graph.pos, graph.t, edge_index, reach, kind)
    return replace(graph, edge_index=edge_index, edge_attr=edge_attr, reach=reach, pseudo=kind)
