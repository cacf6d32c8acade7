"""Events to graphs."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import torch

from nvsdata.events import Events, Recording, as_events
from nvsdata.graph import Graph
from nvsdata.kernels.graph import pseudo_coordinates
from nvsdata.kernels.neighbours import radius_edges
from nvsdata.transforms.checks import not_negative, positive


@dataclass(frozen=True)
class RadiusGraph:
    """Radius graph of events (thesis eq. 4.2).

    Two events are joined, in both directions, if
    sqrt(alpha (dx² + dy²) + beta dt²) <= radius; each node keeps the edges from its `max_degree`
    nearest (by distance, then by index). The node feature is the polarity as ±1.
    """

    radius: float = 3.0
    alpha: float = 1.0
    beta: float = 0.5e-5
    max_degree: int = 32

    def __post_init__(self) -> None:
        positive("radius", self.radius)
        not_negative("alpha", self.alpha)
        not_negative("beta", self.beta)
        positive("max_degree", self.max_degree)

    def __call__(self, sample: Events | Recording) -> Graph:
        return radius_graph(sample, self.radius, alpha=self.alpha, beta=self.beta, max_degree=self.max_degree)


def radius_graph(
    sample: Events | Recording,
    radius: float = 3.0,
    *,
    alpha: float = 1.0,
    beta: float = 0.5e-5,
    max_degree: int = 32,
) -> Graph:
    """Graph with a node an event, in the order of the events; see `RadiusGraph`.

    Time differences are taken in int64, so any time offset gives the same graph.
    """
    events = as_events(sample)
    edges = radius_edges(events.t, events.x, events.y, float(radius), float(alpha), float(beta), max_degree)
    pos = np.empty((len(events), 2), np.float32)
    pos[:, 0] = events.x
    pos[:, 1] = events.y
    # with alpha = 0 the graph has no spatial bound but the sensor itself
    reach = (radius / math.sqrt(alpha),) * 2 if alpha > 0 else tuple(float(v) for v in events.sensor_size)
    feature = np.empty((len(events), 1), np.float32)
    np.multiply(events.p, 2, out=feature[:, 0], casting="unsafe")
    feature -= 1
    return Graph(
        x=torch.from_numpy(feature),
        pos=torch.from_numpy(pos),
        t=torch.from_numpy(events.t - events.start),
        edge_index=torch.from_numpy(edges),
        edge_attr=torch.from_numpy(pseudo_coordinates(pos, edges, np.array(reach, np.float32))),
        sensor_size=events.sensor_size,
        reach=(reach[0], reach[1]),
    )
