"""Nodes that merge the events of a pixel, and node features other than polarity."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Literal, get_args

import numpy as np
import torch

from nvsdata.data.boxes import Boxes
from nvsdata.data.events import Events, check_inside
from nvsdata.data.graph import Graph
from nvsdata.data.recording import Recording, as_events, events_inside, wrong_type
from nvsdata.kernels.represent.patches import merged_pixels, patch_counts
from nvsdata.transforms.apply import with_boxes
from nvsdata.transforms.compose import is_deterministic
from nvsdata.transforms.tensors.event_frames import ToFrames

Time = Literal["first", "last", "mean"]
LARGEST = 17  # pixels along a side of a patch


@dataclass(frozen=True)
class MergePixels:
    """Merge the events of each pixel into one node, as in the graphs that the thesis's author released for UCF101-DVS.

    Args:
        times: Additional features of a node: any of "first", "last" and "mean", the times of its events as fractions of
            the window (default: none).
        log: True for log(1 + number) in place of numbers of events (default False).

    Returns:
        A `Graph` without edges, for `KNNGraph` or `RadiusGraph`. `x` has the numbers of ON and of OFF events, then the
        times; `t` is the mean time, rounded down to µs. Nodes are in order of time. The call takes `Events` or a
        `Recording`.

    Raises:
        ValueError: `times` contains anything else.

    Example:
        >>> from nvsdata import Events, transforms as T
        >>> T.MergePixels()(Events([0, 10, 30], [1, 1, 7], [1, 1, 7], [1, 0, 1], (8, 8))).x.tolist()
        [[1.0, 1.0], [1.0, 0.0]]
    """

    times: tuple[Time, ...] = ()
    log: bool = False
    deterministic: ClassVar[bool] = True

    def __post_init__(self) -> None:
        for time in self.times:
            if time not in get_args(Time):
                raise ValueError(f"times must be of {get_args(Time)}, not {time!r}")

    def __call__(self, sample: Events | Recording) -> Graph:
        events = events_inside(sample)
        pos, mean, ends, counts = merged_pixels(*events.columns)
        found = {"first": ends[:, 0], "last": ends[:, 1], "mean": mean}
        if self.log:
            counts = np.log1p(counts)
        x = np.concatenate((counts, *(_fraction(found[time], events)[:, None] for time in self.times)), 1)
        none = torch.empty((2, 0), dtype=torch.int64)
        made = [torch.from_numpy(array) for array in (x, pos, mean - events.start)]
        return Graph(made[0], made[1], made[2], none, torch.empty(0, 2), None, events.sensor_size)


@dataclass(frozen=True)
class Age:
    """Time of a node's event, as a fraction of the window: a feature for `NodeFeatures`.

    Returns:
        float32 [N, 1], from 0 to 1. The call takes the events and the graph.

    Example:
        >>> from nvsdata import Events, transforms as T
        >>> events = Events([0, 5, 10], [1, 2, 3], [1, 1, 1], [1, 0, 1], (8, 8))
        >>> T.Age()(events, T.RadiusGraph()(events)).tolist()
        [[0.0], [0.5], [1.0]]
    """

    deterministic: ClassVar[bool] = True
    channels: ClassVar[int] = 1

    def __call__(self, events: Events, nodes: Graph) -> torch.Tensor:
        """Return the feature float32 [N, 1] of N nodes."""
        _check_given(events, nodes)
        return torch.from_numpy(_fraction(nodes.t.numpy() + events.start, events)[:, None])


@dataclass(frozen=True)
class Patch:
    """Number of events at each pixel around a node, by polarity: a feature for `NodeFeatures`.

    Args:
        size: Pixels along a side of the patch around the node, odd, at most 17 (default 5).

    Returns:
        float32 [N, 2 size²]: log(1 + count) of each pixel, row by row, first of ON, then of OFF. The call takes the
        events and the graph.

    Raises:
        ValueError: `size` is out of range.

    Example:
        >>> from nvsdata import Events, transforms as T
        >>> events = Events([0, 5, 10], [1, 2, 3], [1, 1, 1], [1, 0, 1], (8, 8))
        >>> T.Patch(3)(events, T.RadiusGraph()(events)).shape
        torch.Size([3, 18])
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
        """Return the feature float32 [N, 2 size²] of N nodes."""
        counts = _counts(events, nodes, self.size)
        return torch.from_numpy(np.log1p(counts).reshape(nodes.num_nodes, self.channels))


@dataclass(frozen=True)
class PatchMean:
    """Number of events around a node and their mean polarity: a feature for `NodeFeatures`.

    Args:
        size: See `Patch` (default 5).

    Returns:
        float32 [N, 2]: log(1 + count) over the patch, and the mean polarity from -1 to 1. The call takes the events and
        the graph.

    Raises:
        ValueError: `size` is out of range.

    Example:
        >>> from nvsdata import Events, transforms as T
        >>> events = Events([0, 5, 10], [1, 2, 3], [1, 1, 1], [1, 0, 1], (8, 8))
        >>> T.PatchMean(3)(events, T.RadiusGraph()(events))[:, 1].tolist()
        [0.0, 0.3333333432674408, 0.0]
    """

    size: int = 5
    deterministic: ClassVar[bool] = True
    channels: ClassVar[int] = 2

    def __post_init__(self) -> None:
        _check_size(self.size)

    def __call__(self, events: Events, nodes: Graph) -> torch.Tensor:
        """Return the feature float32 [N, 2] of N nodes."""
        on, off = _counts(events, nodes, self.size).sum((2, 3)).T
        both = on + off
        return torch.from_numpy(np.stack((np.log1p(both), (on - off) / np.maximum(both, 1)), 1))


@dataclass(frozen=True)
class TimeBins:
    """Number of events at a node's pixel in each of equal parts of the window: a feature for `NodeFeatures`.

    Args:
        bins: Number of parts (default 4).

    Returns:
        float32 [N, 2 bins]: log(1 + count) of each part in order of time, first of ON, then of OFF. The call takes the
        events and the graph.

    Raises:
        ValueError: `bins` isn't a positive integer, or more than 2^24.
        MemoryError: Images of all pixels of the sensor for all parts would take too much memory.

    Example:
        >>> from nvsdata import Events, transforms as T
        >>> events = Events([0, 5, 10], [1, 2, 1], [1, 1, 1], [1, 0, 1], (8, 8))
        >>> T.TimeBins(2)(events, T.RadiusGraph()(events)).expm1().round().tolist()
        [[1.0, 1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0], [1.0, 1.0, 0.0, 0.0]]
    """

    bins: int = 4
    deterministic: ClassVar[bool] = True

    def __post_init__(self) -> None:
        ToFrames(bins=self.bins)

    @property
    def channels(self) -> int:
        """Number of features."""
        return 2 * int(self.bins)

    def __call__(self, events: Events, nodes: Graph) -> torch.Tensor:
        """Return the feature float32 [N, 2 bins] of N nodes."""
        _check_given(events, nodes)
        frames = ToFrames(bins=self.bins)(events)
        position = (nodes.pos.double() + 0.5).floor()
        inside = ((position >= 0) & (position < torch.tensor(events.sensor_size))).all(1)
        # positions that aren't numbers are outside, too
        x, y = torch.where(inside[:, None], position, 0).long().T
        counts = frames[:, :, y, x] * inside
        return torch.log1p(counts.permute(2, 1, 0).reshape(-1, self.channels))


Feature = Callable[[Events, Graph], torch.Tensor]


@dataclass(frozen=True)
class NodeFeatures:
    """Add features to the nodes of a graph. A feature may depend on all events, including those that have no node.

    Args:
        graph: Transform from events to a graph, such as `Compose([NonUniformSample(8), RadiusGraph()])`.
        features: List of `Age`, `Patch`, `PatchMean`, `TimeBins`, or of functions that take the events and the graph
            and return a tensor float32 [N, F] for N nodes.

    Returns:
        The graph, with the new features after its own. The call takes `Events` or a `Recording`.

    Raises:
        TypeError: A feature isn't callable, or the transform returns no graph.
        ValueError: A feature has another number of rows than there are nodes.

    Example:
        >>> import nvsdata
        >>> from nvsdata import transforms as T
        >>> graph = T.Compose([T.NonUniformSample(64), T.RadiusGraph()])
        >>> T.NodeFeatures(graph, [T.Age(), T.Patch(3)])(nvsdata.example()).x.shape[1]
        20
    """

    graph: Callable[[Any], Graph]
    features: Sequence[Feature]

    def __post_init__(self) -> None:
        for feature in (self.graph, *self.features):
            if not callable(feature):
                raise TypeError(f"a feature must be callable, not {feature!r}")

    def __call__(self, sample: Events | Recording) -> Graph:
        events = as_events(sample)
        return self._added(events, self.graph(events))

    def with_boxes(self, sample: Events | Recording, boxes: Boxes) -> tuple[Graph, Boxes]:
        """Return the graph with the new features, and the boxes, which may move with the graph."""
        events = as_events(sample)
        graph, boxes = with_boxes(self.graph, events, boxes)
        return self._added(events, graph), boxes

    def _added(self, events: Events, graph: Graph) -> Graph:
        if not isinstance(graph, Graph):
            raise TypeError(f"{self.graph!r} returns {type(graph).__name__}, not a Graph")
        found = [torch.as_tensor(feature(events, graph), dtype=graph.x.dtype) for feature in self.features]
        for feature, values in zip(self.features, found, strict=True):
            if values.dim() != 2 or len(values) != graph.num_nodes:
                shape = tuple(values.shape)
                raise ValueError(f"{feature!r} returns {shape}, not [{graph.num_nodes}, F] for {graph.num_nodes} nodes")
        return replace(graph, x=torch.cat((graph.x, *found), 1))

    @property
    def deterministic(self) -> bool:
        """True if equal samples have equal results. A subclass must declare it itself."""
        return type(self) is NodeFeatures and all(is_deterministic(part) for part in (self.graph, *self.features))


def _check_size(size: int) -> None:
    if not (size % 2 == 1 and 1 <= size <= LARGEST):
        raise ValueError(f"size must be odd and at most {LARGEST}, not {size}")


def _counts(events: Events, nodes: Graph, size: int) -> np.ndarray:
    _check_given(events, nodes)
    _, x, y, p = check_inside(events).columns
    return np.asarray(patch_counts(x, y, p, nodes.pos.numpy(), int(size)))


def _check_given(events: Events, nodes: Graph) -> None:
    """Raise a TypeError unless a feature gets events and a graph."""
    if not isinstance(events, Events):
        raise wrong_type("events", "Events, such as NodeFeatures passes", events)
    if not isinstance(nodes, Graph):
        raise wrong_type("nodes", "a Graph, such as NodeFeatures passes", nodes)


def _fraction(t: np.ndarray, events: Events) -> np.ndarray:
    """Return times as fractions of the window, float32."""
    return ((t - events.start) / max(events.end - events.start, 1)).astype(np.float32)
