"""Events to graphs."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import torch

from nvsdata.common.validation import not_negative, positive
from nvsdata.data.events import Events
from nvsdata.data.graph import Graph
from nvsdata.data.recording import Recording, as_events
from nvsdata.kernels.graph import event_graph, nearest_event_graph
from nvsdata.transforms.defaults import BETA


@dataclass(frozen=True)
class RadiusGraph:
    """Radius graph of events (thesis eq. 4.2).

    Two events are connected, in both directions, if sqrt(alpha (dx² + dy²) + beta dt²) <= radius, with dx and dy in
    pixels and dt in µs. Each node keeps the edges from its `max_degree` nearest neighbors (by distance, then by
    index).

    - `radius`: largest distance (default 3.0)
    - `alpha`: weight of squared pixels (default 1.0)
    - `beta`: weight of squared µs (default 0.5e-5)
    - `max_degree`: largest number of edges that end in a node (default 32)

    Takes `Events` or a `Recording`, gives a `Graph` with one node per event in the same order, and the polarity
    as ±1 as its feature. ValueError for settings out of range.
    """

    radius: float = 3.0
    alpha: float = 1.0
    beta: float = BETA
    max_degree: int = 32
    deterministic: ClassVar[bool] = True

    def __post_init__(self) -> None:
        positive("radius", self.radius)
        not_negative("alpha", self.alpha)
        not_negative("beta", self.beta)
        positive("max_degree", self.max_degree)

    def __call__(self, sample: Events | Recording) -> Graph:
        return radius_graph(sample, self.radius, alpha=self.alpha, beta=self.beta, max_degree=self.max_degree)


@dataclass(frozen=True)
class KNNGraph:
    """Nearest-neighbor graph of events, k = 1 (thesis 5.3.1): each event is the target of one edge.

    The source of the edge is the nearest other event by alpha (dx² + dy²) + beta dt², then by index, with dx and dy
    in pixels and dt in µs.

    - `alpha`: weight of squared pixels, above 0 (default 1.0)
    - `beta`: weight of squared µs (default 0.5e-5)
    - `reach`: pixels for which a pseudo-coordinate is 1 (default 8.0); longer edges also count as 1. In the graphs
      that the thesis's author released, 99% of the edges of busy graphs are shorter.

    Takes `Events` or a `Recording`, gives a `Graph` with one node per event in the same order. ValueError for
    settings out of range.
    """

    alpha: float = 1.0
    beta: float = BETA
    reach: float = 8.0
    deterministic: ClassVar[bool] = True

    def __post_init__(self) -> None:
        positive("alpha", self.alpha)
        not_negative("beta", self.beta)
        positive("reach", self.reach)

    def __call__(self, sample: Events | Recording) -> Graph:
        return knn_graph(sample, alpha=self.alpha, beta=self.beta, reach=self.reach)


def knn_graph(sample: Events | Recording, *, alpha: float = 1.0, beta: float = BETA, reach: float = 8.0) -> Graph:
    """Graph with one node per event and one edge per node; see `KNNGraph`."""
    events = as_events(sample)
    reaches = (float(reach), float(reach))
    arrays = nearest_event_graph(*events.columns, events.start, float(alpha), float(beta), reaches)
    x, pos, t, edge_index, edge_attr = map(torch.from_numpy, arrays)
    return Graph(x, pos, t, edge_index, edge_attr, None, events.sensor_size, reaches)


def radius_graph(
    sample: Events | Recording,
    radius: float = 3.0,
    *,
    alpha: float = 1.0,
    beta: float = BETA,
    max_degree: int = 32,
) -> Graph:
    """Graph with one node per event, in the order of the events; see `RadiusGraph`.

    Time differences are computed in int64, so any time offset gives the same graph.
    """
    events = as_events(sample)
    # with alpha = 0 only the sensor itself bounds the graph in space
    side = radius / math.sqrt(alpha) if alpha > 0 else 0.0
    reach = (side, side) if side else (float(events.sensor_size[0]), float(events.sensor_size[1]))
    arrays = event_graph(*events.columns, events.start, float(radius), float(alpha), float(beta), max_degree, reach)
    x, pos, t, edge_index, edge_attr = map(torch.from_numpy, arrays)
    return Graph(x, pos, t, edge_index, edge_attr, None, events.sensor_size, reach)
