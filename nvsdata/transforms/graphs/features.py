"""Nodes and their features: the events of a pixel merged, and more than polarity."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Literal, get_args

import numpy as np
import torch

from nvsdata.data.events import Events, check_inside
from nvsdata.data.graph import Graph
from nvsdata.data.recording import Recording, as_events, events_inside, wrong_type
from nvsdata.kernels.represent.patches import merged_pixels, patch_counts
from nvsdata.transforms.compose import is_deterministic

Time = Literal["first", "last", "mean"]
LARGEST = 17  # pixels along a side of a patch


@dataclass(frozen=True)
class MergePixels:
    """The events of each pixel as one node, as in the graphs that the thesis's author released for UCF101-DVS.

    - `times`: further features of a node, any of "first", "last" and "mean": times of its events, as shares of the
      window (default none)

    Takes `Events` or a `Recording`, gives a `Graph` without edges, for `KNNGraph` or `RadiusGraph`: `x` has the number
    of events of polarity 1 and of polarity 0, then the times; `t` is the mean time, rounded down to µs. Nodes are in
    order of time. ValueError for other times.
    """

    times: tuple[Time, ...] = ()
    deterministic: ClassVar[bool] = True

    def __post_init__(self) -> None:
        for time in self.times:
            if time not in get_args(Time):
                raise ValueError(f"times must be of {get_args(Time)}, not {time!r}")

    def __call__(self, sample: Events | Recording) -> Graph:
        events = events_inside(sample)
        pos, mean, ends, counts = merged_pixels(*events.columns)
        found = {"first": ends[:, 0], "last": ends[:, 1], "mean": mean}
        x = np.concatenate((counts, *(_share(found[time], events)[:, None] for time in self.times)), 1)
        none = torch.empty((2, 0), dtype=torch.int64)
        made = [torch.from_numpy(array) for array in (x, pos, mean - events.start)]
        return Graph(made[0], made[1], made[2], none, torch.empty(0, 2), None, events.sensor_size)


def merge_pixels(sample: Events | Recording, times: Sequence[Time] = ()) -> Graph:
    """Graph without edges, of a node per pixel that has events; see `MergePixels`."""
    return MergePixels(tuple(times))(sample)


@dataclass(frozen=True)
class Age:
    """When a node's event occurred, as a share of the window: a feature for `NodeFeatures`."""

    deterministic: ClassVar[bool] = True
    channels: ClassVar[int] = 1

    def __call__(self, events: Events, nodes: Graph) -> torch.Tensor:
        """float32 [N, 1], from 0 to 1."""
        _check_given(events, nodes)
        return torch.from_numpy(_share(nodes.t.numpy() + events.start, events)[:, None])


@dataclass(frozen=True)
class Patch:
    """How many events each pixel around a node has, by polarity: a feature for `NodeFeatures`.

    - `size`: pixels along a side of the patch around the node, odd, at most 17 (default 5)

    The features are log(1 + count) of size² pixels, row by row, first of polarity 1, then of polarity 0: 2 size² in
    all. ValueError for another size.
    """

    size: int = 5
    deterministic: ClassVar[bool] = True

    def __post_init__(self) -> None:
        _check_size(self.size)

    @property
    def channels(self) -> int:
        """Number of features."""
        return 2 * int(self.size) ** 2

    def __call__(self, events: Events, nodes: Graph) -> torch.Tensor:
        """float32 [N, 2 size²]."""
        counts = _counts(events, nodes, self.size)
        return torch.from_numpy(np.log1p(counts).reshape(nodes.num_nodes, self.channels))


@dataclass(frozen=True)
class PatchMean:
    """How many events there are around a node, and of which polarity: a feature for `NodeFeatures`.

    - `size`: see `Patch` (default 5)

    The features are log(1 + count) over the patch, and the mean polarity, from -1 to 1. ValueError as for `Patch`.
    """

    size: int = 5
    deterministic: ClassVar[bool] = True
    channels: ClassVar[int] = 2

    def __post_init__(self) -> None:
        _check_size(self.size)

    def __call__(self, events: Events, nodes: Graph) -> torch.Tensor:
        """float32 [N, 2]."""
        on, off = _counts(events, nodes, self.size).sum((2, 3)).T
        both = on + off
        return torch.from_numpy(np.stack((np.log1p(both), (on - off) / np.maximum(both, 1)), 1))


Feature = Callable[[Events, Graph], torch.Tensor]


@dataclass(frozen=True)
class NodeFeatures:
    """A graph of events whose nodes have further features, of all events, sampled or not.

    - `graph`: transform from events to a graph, such as `Compose([NonUniformSample(8), RadiusGraph()])`
    - `features`: a list of `Age`, `Patch`, `PatchMean`, or of functions that take the events and the graph and give
      a tensor float32 [N, F]

    Takes `Events` or a `Recording`, gives the graph with the features after those it had. TypeError for features that
    aren't callable, and a transform that gives no graph; ValueError for a feature that gives another number of rows
    than there are nodes.
    """

    graph: Callable[[Any], Graph]
    features: Sequence[Feature]

    def __post_init__(self) -> None:
        for feature in (self.graph, *self.features):
            if not callable(feature):
                raise TypeError(f"a feature must be callable, not {feature!r}")

    def __call__(self, sample: Events | Recording) -> Graph:
        events = as_events(sample)
        graph = self.graph(events)
        if not isinstance(graph, Graph):
            raise TypeError(f"{self.graph!r} gives {type(graph).__name__}, not a Graph")
        found = [torch.as_tensor(feature(events, graph), dtype=graph.x.dtype) for feature in self.features]
        for feature, values in zip(self.features, found, strict=True):
            if values.dim() != 2 or len(values) != graph.num_nodes:
                shape = tuple(values.shape)
                raise ValueError(f"{feature!r} gives {shape}, not [{graph.num_nodes}, F] for {graph.num_nodes} nodes")
        return replace(graph, x=torch.cat((graph.x, *found), 1))

    @property
    def deterministic(self) -> bool:
        """Whether the same sample always gives the same result; a subclass must declare it itself."""
        return type(self) is NodeFeatures and all(is_deterministic(part) for part in (self.graph, *self.features))


def _check_size(size: int) -> None:
    if not (size % 2 == 1 and 1 <= size <= LARGEST):
        raise ValueError(f"size must be odd, and at most {LARGEST}, not {size}")


def _counts(events: Events, nodes: Graph, size: int) -> np.ndarray:
    _check_given(events, nodes)
    _, x, y, p = check_inside(events).columns
    return np.asarray(patch_counts(x, y, p, nodes.pos.numpy(), int(size)))


def _check_given(events: Events, nodes: Graph) -> None:
    """TypeError unless a feature is given what it is of."""
    for kind, given in ((Events, events), (Graph, nodes)):
        if not isinstance(given, kind):
            raise wrong_type("Events and their Graph, as NodeFeatures gives them", given)


def _share(t: np.ndarray, events: Events) -> np.ndarray:
    """Times as shares of the window, float32."""
    return ((t - events.start) / max(events.end - events.start, 1)).astype(np.float32)
