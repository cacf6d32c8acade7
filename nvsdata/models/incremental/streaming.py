"""Incremental inference (thesis, section 6.2): class scores of a stream of events, by updates of node features."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any

import torch
from torch import nn

from nvsdata.common.validation import whole
from nvsdata.data.events import Columns, Events, check_inside, concatenate
from nvsdata.data.graph import Graph
from nvsdata.models.incremental.network import IncrementalCausalNetwork, IncrementalNetwork, NetworkLayers
from nvsdata.transforms.compose import Compose
from nvsdata.transforms.events.causal_filters import CausalFilter
from nvsdata.transforms.graphs.edges import RadiusGraph
from nvsdata.transforms.graphs.features import NodeFeatures

FOREVER = 2**62  # µs, longer than any window
MANY = 24  # if more than 1/24 of the window's events enter or leave, the entire window is computed
CALM = 2  # number of consecutive steps with few changes, after which node features are kept and updated


def stream(
    model: nn.Module,
    window: int | None = 30_000,
    graph: RadiusGraph | NodeFeatures | None = None,
    sampler: CausalFilter | None = None,
) -> Stream | CausalStream:
    """Start incremental inference: feed events, and get a network's scores for the last `window` µs at any moment.

    Args:
        model: Trained `RGCNN` or `GCNN` of B-spline convolutions, in evaluation mode; or an `RGCNN3D`, whose graph part
            streams: `grid()` then returns the window's frame for the 3D CNN.
        window: Length in µs (default 30,000). The window ends with the last event, inclusive. None for all events.
        graph: Graph that the network was trained with (default `RadiusGraph()`). A causal graph needs a network that
            pools after its last block only (other clusters are None); see `CausalStream`. With `NodeFeatures` of a
            `RadiusGraph`, the entire window is computed whenever scores are requested, because features such as `Patch`
            change with every event around a node.
        sampler: Filter that events pass first, such as `transforms.RateLimit` (default: none).

    Returns:
        A `CausalStream` for a causal graph, otherwise a `Stream`.

    Raises:
        ValueError: For a network in training mode, a network with a layer that can't stream (the message names it),
            graphs without bound in space, and a window below 1 µs.

    Example:
        >>> from nvsdata import Events, models
        >>> live = models.stream(models.rgcnn("n-mnist").eval(), window=30_000)
        >>> live.feed(Events([0, 900], [3, 4], [5, 5], [1, 0], (34, 34)))
        >>> live.scores().shape
        torch.Size([10])
    """
    graph = graph or RadiusGraph()
    if isinstance(graph, NodeFeatures):
        if not graph.deterministic:
            raise ValueError(f"{graph} can't stream: it isn't deterministic")
        if getattr(_edges_of(graph), "causal", False):
            raise ValueError(f"{graph} can't stream on a causal graph: its features depend on later events")
    kind = CausalStream if isinstance(graph, RadiusGraph) and graph.causal else Stream
    return kind(model, window, graph, sampler)


def _edges_of(graph: Any) -> Any:
    """Return the transform that makes the edges, taken out of `NodeFeatures` and out of a `Compose` of one step."""
    if isinstance(graph, NodeFeatures):
        graph = graph.graph
    if isinstance(graph, Compose) and len(graph.transforms) == 1:
        graph = graph.transforms[0]
    return graph


class _IncrementalInference(ABC):
    """Base class of `Stream` and `CausalStream`: a network, a sliding window of events, a graph and a sampler."""

    def __init__(self, model: nn.Module, window: int | None, graph: Any, sampler: CausalFilter | None) -> None:
        if window is not None:
            whole("window", window, 1)
            window = min(int(window), FOREVER)
        if sampler is not None and not isinstance(sampler, CausalFilter):
            raise ValueError(f"{sampler} can't stream: causal filters can, such as RateLimit")
        self.window, self.graph, self.sampler = window, graph, sampler
        self._has_features = isinstance(graph, NodeFeatures)
        channels = graph(Events.empty((1, 1))).x.shape[1] if self._has_features else 1
        self._network = NetworkLayers(model, _edges_of(graph), channels)
        self.reset()

    def reset(self) -> None:
        """Forget all events."""
        self.products = 0
        self._last: int | None = None
        self._origin = 0
        self._sieve = self.sampler.begin(self._network.sensor_size) if self.sampler else None

    def feed(self, events: Events) -> None:
        """Add any number of events. Their times must not precede those of events that were fed before.

        ValueError for events that go back in time, events of a sensor larger than the network's, and events outside the
        sensor.
        """
        width, height = self._network.sensor_size
        if events.sensor_size[0] > width or events.sensor_size[1] > height:
            given = "x".join(map(str, events.sensor_size))
            raise ValueError(f"events of a sensor of {given}, but the network is for {width}x{height}")
        if not len(events):
            return
        check_inside(events)
        first, last = int(events.t[0]), int(events.t[-1])
        if self._last is None:
            self._origin = first
        elif first < self._last:
            raise ValueError(f"events go back in time: to {first} µs, after {self._last}")
        self._last = last
        columns = (self._sieve(events) if self._sieve else events).columns
        self._take(columns._replace(t=columns.t - self._origin))

    @property
    def _until(self) -> int:
        """Start of the window in µs since the first event; earlier events have left the window."""
        return -FOREVER if self.window is None or self._last is None else self._last - self._origin - self.window + 1

    @abstractmethod
    def _take(self, columns: Columns) -> None:
        """Add events that passed the sampler, perhaps none. Events before `_until` have left the window."""

    @abstractmethod
    def __len__(self) -> int:
        """Number of events in the window."""

    @abstractmethod
    def grid(self) -> torch.Tensor:
        """Return the features of the last pooling, as `Graph2Grid` arranges them: float32 [C, rows, columns]."""

    def scores(self) -> torch.Tensor:
        """Return class scores (logits) float32 [num_classes] of the window; without events, those of an empty graph.

        ValueError for RGCNN3D, whose 3D CNN takes sequences of grids.
        """
        if not self._network.has_scores:
            raise ValueError(
                "RGCNN3D has no scores for one window: call grid() for each window, and pass the grids to its 3D CNN"
            )
        return self._scores()

    @abstractmethod
    def _scores(self) -> torch.Tensor: ...


class Stream(_IncrementalInference):
    """Incremental inference of a network on a graph; made by `stream`.

    The scores are those of the network on `graph` of the events in the window, up to rounding, regardless of how the
    events were divided into pieces. Nothing is computed until scores are requested. After few new events, only node
    features that changed are computed; after many, the entire window. Memory grows with the largest number of events in
    the window, and with the number of cells of the pooled graphs.

    Attributes:
        products: Number of multiplications for updated node features since construction or `reset`.
    """

    def reset(self) -> None:
        """Forget all events."""
        super().reset()
        self._waiting: list[Columns] = []
        # events of the window while no node features are kept, and the number of consecutive steps with few changes
        self._held, self._calm = Columns.empty(0), 0
        self._live: IncrementalNetwork | None = None
        self._found: torch.Tensor | None = None
        self._seen = -FOREVER

    def _take(self, columns: Columns) -> None:
        if columns.t.size:
            # copies, because the caller may use its arrays again
            self._waiting.append(Columns(columns.t, *(column.copy() for column in columns[1:])))
        # drop pieces that have left the window; searched once per window, because there may be many
        if self._waiting and self._waiting[0].t[-1] < self._until - (self.window or 0):
            self._waiting = [piece for piece in self._waiting if piece.t[-1] >= self._until]

    def _scores(self) -> torch.Tensor:
        self._catch_up()
        if self._found is None and self._live is not None:
            self._found = self._network.scores(self._live.hidden)
        elif self._found is None:
            with torch.no_grad():
                self._found = self._network.model(self._graph_of_all())[0]
        return self._found.clone()

    def grid(self) -> torch.Tensor:
        """Return the features of the last pooling, as `Graph2Grid` arranges them: float32 [C, rows, columns]."""
        self._catch_up()
        if self._live is not None:
            return self._network.as_grid(self._live.shown)
        return self._network.grid_of(self._graph_of_all())

    def _graph_of_all(self) -> Graph:
        """Return the graph of the entire window, for which no node features are kept."""
        start, end = 0, 0
        if self._last is not None:
            end = self._last - self._origin
            # a half-open range, as for windows of recordings
            start, end = (0, end) if self.window is None else (end + 1 - self.window, end + 1)
        graph: Graph = self.graph(Events.trusted(self._held, self._network.sensor_size, start, end))
        return graph

    def __len__(self) -> int:
        """Number of events in the window."""
        self._catch_up()
        return self._held.t.size if self._live is None else len(self._live)

    def _catch_up(self) -> None:
        """Process the events that were fed since the last call."""
        until = self._until
        if not self._waiting and until == self._seen:
            return
        self._found, self._seen = None, until
        new = concatenate(self._waiting or [Columns.empty(0)])
        new = new.take(slice(int(new.t.searchsorted(until)), None))
        self._waiting = []
        before = len(self._live) if self._live is not None else self._held.t.size
        past = self._live.count_before(until) if self._live is not None else int(self._held.t.searchsorted(until))
        few = (past + new.t.size) * MANY <= before + new.t.size
        if self._live is not None and few:
            self._step(until, new)
            return
        if self._live is not None:
            self._held, self._live, self._calm = self._live.columns(), None, 0
        self._held = concatenate([self._held.take(slice(past, None)), new])
        # node features change with every event around a node
        self._calm = self._calm + 1 if few and not self._has_features else 0
        if self._calm == CALM:
            self._live = IncrementalNetwork(self._network)
            self._step(until, self._held)
            self._held = Columns.empty(0)

    def _step(self, until: int, new: Columns) -> None:
        assert self._live is not None
        before = self._live.products
        self._live.step(until, *new)
        self.products += self._live.products - before


class CausalStream(_IncrementalInference):
    """Incremental inference of a network on a causal graph; made by `stream`.

    The neighbors of an event are among the events in the window at its time. Its features in each layer are computed
    once, in `feed`. The scores are computed from the maxima over the events in the window. Until the first event leaves
    the window, the scores are those of the network on `graph` of all events, up to rounding. Afterwards, the
    features of events at the beginning of the window still depend on neighbors that have left it, unlike in a graph of
    the window alone.

    Attributes:
        products: Number of multiplications since construction or `reset`.
    """

    def reset(self) -> None:
        """Forget all events."""
        super().reset()
        self._live = IncrementalCausalNetwork(self._network, self.window)

    def _take(self, columns: Columns) -> None:
        self._live.step(self._until, *columns)
        self.products = self._live.products

    def _scores(self) -> torch.Tensor:
        return self._network.scores(self._live.hidden)

    def grid(self) -> torch.Tensor:
        """Return the features of the last pooling, as `Graph2Grid` arranges them: float32 [C, rows, columns]."""
        return self._network.as_grid(self._live.shown)

    def __len__(self) -> int:
        """Number of events in the window."""
        return len(self._live)
