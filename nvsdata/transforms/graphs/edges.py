"""Events to graphs."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
import torch

from nvsdata.common.validation import not_negative, positive, whole
from nvsdata.data.events import Events
from nvsdata.data.graph import Graph, GraphBatch
from nvsdata.data.pseudo import Pseudo, Reach, axes, check_pseudo, pseudo
from nvsdata.data.recording import Recording, as_events, wrong_type
from nvsdata.kernels.decode.order import is_sorted
from nvsdata.kernels.graph.edges import event_graph
from nvsdata.kernels.graph.neighbors import near_edges
from nvsdata.kernels.streaming.earlier import earlier_edges
from nvsdata.transforms.defaults import BETA, PSEUDO, REACH_T

SHORTEST = float(np.finfo(np.float32).tiny)
LARGEST = 2**26  # pixels around the nodes of a causal graph
FURTHEST = 32_767  # pixels between nodes, as between events


@dataclass(frozen=True)
class RadiusGraph:
    """Radius graph of events (thesis eq. 4.2).

    Two events are connected, in both directions, if sqrt(alpha (dx² + dy²) + beta dt²) <= radius, with dx and dy in
    pixels and dt in µs. Each node keeps the edges from its `max_degree` nearest neighbors: by this distance, of
    equals by time, then by index.

    - `radius`: largest distance (default 3.0)
    - `alpha`: weight of squared pixels (default 1.0)
    - `beta`: weight of squared µs (default (0.5e-5)², as in the author's graphs, where time is scaled by 0.5e-5 per µs
      and then squared: neighbors are near in space, at any time of the window). 0.5e-5 is the literal reading of the
      thesis, with which 1.3 ms are as far as 3 pixels, and most nodes have no neighbor.
    - `max_degree`: largest number of edges that end in a node (default 32)
    - `pseudo`: kind of pseudo-coordinates (default "signed", as in the author's code): "abs" (the text) has |dx| and
      |dy|, "signed" dx and dy, "signed-time" also dt
    - `reach_t`: µs that the end of the time axis of "signed-time" stands for (default 15,000, which 90% of the edges in
      windows of 30 ms are within)
    - `causal`: edges lead from earlier events to later ones only, so that what a node hears is settled when it comes;
      of those at one time, index decides (default False)

    Takes `Events` or a `Recording`, gives a `Graph` with one node per event in the same order, and the polarity
    as ±1 as its feature. Takes a `Graph`, such as `MergePixels` gives, too, and gives its nodes new edges. ValueError
    for settings out of range.
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
        sample = sample if isinstance(sample, Graph) else as_events(sample)
        metric = float(self.radius), float(self.alpha), float(self.beta), int(self.max_degree)
        reach = self.reach(sample.sensor_size or (1, 1))
        if self.causal:
            return _joined_again(_nodes(sample), self._earlier, reach, self.pseudo)
        return _joined(sample, metric, reach, self.pseudo)

    def _earlier(self, t: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Edges from earlier nodes to later ones."""
        width, height = int(x.max(initial=0)) + 1, int(y.max(initial=0)) + 1
        if width * height > LARGEST:
            raise ValueError(f"nodes of a causal graph must lie in {LARGEST:,} pixels, not {width}x{height}")
        metric = float(self.radius), float(self.alpha), float(self.beta)
        return earlier_edges(t, x, y, (width, height), metric, int(self.max_degree))

    def reach(self, sensor_size: tuple[int, int]) -> Reach:
        """What the ends of the axes of the pseudo-coordinates stand for, in pixels and µs."""
        # with alpha = 0 only the sensor itself bounds the graph in space
        side = self.radius / math.sqrt(self.alpha) if self.alpha > 0 else 0.0
        wide, high = (side, side) if side else sensor_size
        return _reach(wide, high, self.reach_t, self.pseudo)


@dataclass(frozen=True)
class KNNGraph:
    """Nearest-neighbor graph of events (thesis 5.3.1): each event is the target of `k` edges.

    Their sources are the other events that are nearest in space; of equals those nearer in time, then those of smaller
    index. An event has fewer only if there are no more than `k` events.

    - `k`: neighbors of an event (default 1)
    - `reach`: pixels that the end of an axis of the pseudo-coordinates stands for (default 8.0); longer edges count as
      that. In the graphs that the thesis's author released, 99% of the edges of busy graphs are shorter.
    - `pseudo`, `reach_t`: see `RadiusGraph`

    Takes `Events`, a `Recording` or a `Graph`, gives a `Graph`; see `RadiusGraph`. ValueError for settings out of
    range.
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
        metric = math.inf, 1.0, 0.0, int(self.k)
        return _joined(sample, metric, _reach(self.reach, self.reach, self.reach_t, self.pseudo), self.pseudo)


def knn_graph(
    sample: Events | Recording | Graph,
    k: int = 1,
    *,
    reach: float = 8.0,
    pseudo: Pseudo = PSEUDO,
    reach_t: int = REACH_T,
) -> Graph:
    """Graph with one node per event and edges from its `k` nearest; see `KNNGraph`."""
    return KNNGraph(k, reach, pseudo, reach_t)(sample)


def radius_graph(
    sample: Events | Recording | Graph,
    radius: float = 3.0,
    *,
    alpha: float = 1.0,
    beta: float = BETA,
    max_degree: int = 32,
    pseudo: Pseudo = PSEUDO,
    reach_t: int = REACH_T,
    causal: bool = False,
) -> Graph:
    """Graph with one node per event, in the order of the events; see `RadiusGraph`.

    Time differences are computed in int64, so any time offset gives the same graph.
    """
    return RadiusGraph(radius, alpha, beta, max_degree, pseudo, reach_t, causal)(sample)


def _reach(wide: float, high: float, reach_t: int, kind: Pseudo) -> Reach:
    # in float32 a smaller one would be 0, which nothing can be a share of
    return tuple(max(float(end), SHORTEST) for end in (wide, high, reach_t))[: axes(kind)]


Limits = tuple[float, float, float, int]  # radius, alpha, beta and D_max


def _joined(sample: Events | Recording | Graph, metric: Limits, reach: Reach, kind: Pseudo) -> Graph:
    if isinstance(sample, Graph):
        return _joined_again(sample, lambda t, x, y: near_edges(t, x, y, *metric), reach, kind)
    events = as_events(sample)
    arrays = event_graph(*events.columns, events.start, *metric, reach, kind != "abs")
    x, pos, t, edge_index, edge_attr = map(torch.from_numpy, arrays)
    return Graph(x, pos, t, edge_index, edge_attr, None, events.sensor_size, reach, kind)


Near = Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]


def _nodes(sample: Events | Recording | Graph) -> Graph:
    """A graph, or events as one without edges."""
    if isinstance(sample, Graph):
        return sample
    events = as_events(sample)
    x = torch.from_numpy(2 * events.p.astype(np.float32) - 1)[:, None]
    pos = torch.from_numpy(np.stack((events.x, events.y), 1).astype(np.float32))
    none = torch.empty((2, 0), dtype=torch.int64)
    return Graph(x, pos, torch.from_numpy(events.t - events.start), none, torch.empty(0, 2), None, events.sensor_size)


def _joined_again(graph: Graph, near: Near, reach: Reach, kind: Pseudo) -> Graph:
    """The same nodes with new edges between them; nodes are taken to lie at the nearest whole pixels.

    `near` gives edges int64 [2, E] of t, x and y in order of time.
    """
    if isinstance(graph, GraphBatch):
        raise wrong_type("Events, a Recording or a single graph", graph)
    order = np.argsort(graph.t.numpy(), kind="stable")
    places = np.rint(graph.pos.numpy()[order])
    with np.errstate(invalid="ignore"):
        # from 0 on, as the kernel needs them
        places -= places.min(0, initial=np.inf)
    if not (places <= FURTHEST).all():
        raise ValueError(f"nodes must be at finite positions, at most {FURTHEST} pixels apart along an axis")
    x, y = places.T.astype(np.int32)
    edges = near(graph.t.numpy()[order], x, y)
    if not is_sorted(order):
        # by target again, because the nodes weren't in order of time
        edges = order[edges]
        edges = edges[:, np.lexsort(edges)]
    edge_index = torch.from_numpy(edges)
    edge_attr = pseudo(graph.pos, graph.t, edge_index, reach, kind)
    return replace(graph, edge_index=edge_index, edge_attr=edge_attr, reach=reach, pseudo=kind)
