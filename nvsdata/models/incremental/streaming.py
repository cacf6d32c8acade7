"""Graph networks whose scores follow events: only rows that change are computed (thesis 6.2)."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any

import torch
from torch import nn

from nvsdata.common.validation import whole
from nvsdata.data.events import Columns, Events, check_inside, concatenate
from nvsdata.data.graph import Graph
from nvsdata.models.incremental.causal import IncrementalCausalNetwork
from nvsdata.models.incremental.network import IncrementalNetwork, NetworkLayers
from nvsdata.transforms.compose import Compose
from nvsdata.transforms.events.causal_filters import CausalFilter
from nvsdata.transforms.graphs.edges import RadiusGraph
from nvsdata.transforms.graphs.features import NodeFeatures

FOREVER = 2**62  # µs, longer than any window
MANY = 24  # part of the window's events that come or go from which the whole is computed
CALM = 2  # steps with few changes in a row from which rows are kept


def stream(
    model: nn.Module,
    window: int | None = 30_000,
    graph: RadiusGraph | NodeFeatures | None = None,
    sampler: CausalFilter | None = None,
) -> Stream | CausalStream:
    """An object that is fed events, and has a network's scores of the last `window` µs at any moment; see `Stream`.

    - `model`: an `RGCNN` or `GCNN` of B-spline convolutions, as trained, or an `RGCNN3D`, whose graph part streams:
      `grid()` then has the window's frame for the 3D CNN
    - `window`: µs up to the last event, its own included, whose events count (default 30,000); None for all
    - `graph`: that the network was trained with (default `RadiusGraph()`). A causal one needs a network that pools
      after its last block only (clusters of None before); a row is final then once it is computed, see `CausalStream`.
      With `NodeFeatures` of a `RadiusGraph` the whole window is computed at each decision, because features such as
      `Patch` change with every event around a node
    - `sampler`: that events pass first, such as `transforms.RateLimit` (default: none)

    ValueError for a network in training mode, or one that can't stream, by the name of its part, for graphs without
    bound in space, and for a window below 1 µs.
    """
    graph = graph or RadiusGraph()
    if isinstance(graph, NodeFeatures):
        if not graph.deterministic:
            raise ValueError(f"{graph} can't stream: it isn't deterministic")
        if getattr(_edges_of(graph), "causal", False):
            raise ValueError(f"{graph} can't stream on a causal graph: its features know events to come")
    kind = CausalStream if isinstance(graph, RadiusGraph) and graph.causal else Stream
    return kind(model, window, graph, sampler)


def _edges_of(graph: Any) -> Any:
    """Return the transform that makes the edges of a graph whose nodes may have features."""
    if isinstance(graph, NodeFeatures):
        graph = graph.graph
    if isinstance(graph, Compose) and len(graph.transforms) == 1:
        graph = graph.transforms[0]
    return graph


class _IncrementalInference(ABC):
    """Incremental inference of a network in a window, on a graph."""

    def __init__(self, model: nn.Module, window: int | None, graph: Any, sampler: CausalFilter | None) -> None:
        if window is not None:
            whole("window", window, 1)
            window = min(int(window), FOREVER)
        if sampler is not None and not isinstance(sampler, CausalFilter):
            raise ValueError(f"{sampler} can't stream: samplers that look back only can, such as RateLimit")
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
        """Take events, any number, none of them before one that was fed.

        ValueError for events that fall back in time, those of a sensor larger than the network's, and those outside it.
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
            raise ValueError(f"events fall back in time: to {first} µs, after {self._last}")
        self._last = last
        columns = (self._sieve(events) if self._sieve else events).columns
        self._take(columns._replace(t=columns.t - self._origin))

    @property
    def _until(self) -> int:
        """The time before which events are over, in the clock that begins with the first one."""
        return -FOREVER if self.window is None or self._last is None else self._last - self._origin - self.window + 1

    @abstractmethod
    def _take(self, columns: Columns) -> None:
        """Take events that passed the sampler, perhaps none; those before `_until` are over."""

    @abstractmethod
    def __len__(self) -> int:
        """Number of events in the window."""

    @abstractmethod
    def grid(self) -> torch.Tensor:
        """Features of the last pooling as `Graph2Grid` has them, float32 [C, rows, columns], for a 3D CNN, say."""

    def scores(self) -> torch.Tensor:
        """Class scores (logits) float32 [num_classes] of the events in the window; without any, of an empty graph.

        ValueError for RGCNN3D, whose 3D CNN takes sequences: give it grids.
        """
        if not self._network.has_scores:
            raise ValueError("the 3D CNN takes sequences: give it grids, grid() has that of the window")
        return self._scores()

    @abstractmethod
    def _scores(self) -> torch.Tensor: ...


class Stream(_IncrementalInference):
    """A network that follows events; made by `stream`.

    Its scores are those of the network on `graph` of the events in the window, up to rounding, however events were cut.
    Nothing is computed before scores are asked for; then, after few new events, only rows that changed, and after many
    the whole window. Memory is in proportion to the most events that the window had, and to the pooled graphs' cells.

    - `products`: multiplications since it was made or reset, in rows that changed
    """

    def reset(self) -> None:
        """Forget all events."""
        super().reset()
        self._waiting: list[Columns] = []
        # events whose rows aren't kept, and how many steps with few changes there were since
        self._held, self._calm = Columns.empty(0), 0
        self._live: IncrementalNetwork | None = None
        self._found: torch.Tensor | None = None
        self._seen = -FOREVER

    def _take(self, columns: Columns) -> None:
        if columns.t.size:
            # copies, because the caller may use its arrays again
            self._waiting.append(Columns(columns.t, *(column.copy() for column in columns[1:])))
        # pieces that are over needn't wait; looked for once a window, because there may be many
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
        """Features of the last pooling as `Graph2Grid` has them, float32 [C, rows, columns], for a 3D CNN, say."""
        self._catch_up()
        if self._live is not None:
            return self._network.as_grid(self._live.shown)
        return self._network.grid_of(self._graph_of_all())

    def _graph_of_all(self) -> Graph:
        """The graph of the window, whose rows aren't kept."""
        start, end = 0, 0
        if self._last is not None:
            end = self._last - self._origin
            # as windows of recordings are, whose end is their first moment that is over
            start, end = (0, end) if self.window is None else (end + 1 - self.window, end + 1)
        graph: Graph = self.graph(Events.trusted(self._held, self._network.sensor_size, start, end))
        return graph

    def __len__(self) -> int:
        """Number of events in the window."""
        self._catch_up()
        return self._held.t.size if self._live is None else len(self._live)

    def _catch_up(self) -> None:
        """Take the events that wait."""
        until = self._until
        if not self._waiting and until == self._seen:
            return
        self._found, self._seen = None, until
        new = concatenate(self._waiting or [Columns.empty(0)])
        new = new.take(slice(int(new.t.searchsorted(until)), None))
        self._waiting = []
        before = len(self._live) if self._live is not None else self._held.t.size
        over = self._live.over(until) if self._live is not None else int(self._held.t.searchsorted(until))
        few = (over + new.t.size) * MANY <= before + new.t.size
        if self._live is not None and few:
            self._step(until, new)
            return
        if self._live is not None:
            self._held, self._live, self._calm = self._live.columns(), None, 0
        self._held = concatenate([self._held.take(slice(over, None)), new])
        # features of nodes change with all events around
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
    """A network on a causal graph that follows events; made by `stream`.

    An event's neighbors are among those that the window held when it came, its rows are computed once, at `feed`, and
    the network sees the maxima over the events in the window. As long as none has gone, scores are those of the network
    on `graph` of all events, up to rounding; afterwards events at the window's beginning still know their neighbors,
    which a graph of the window alone lacks.

    - `products`: multiplications since it was made or reset
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
        """Features of the pooling as `Graph2Grid` has them, float32 [C, rows, columns]."""
        return self._network.as_grid(self._live.shown)

    def __len__(self) -> int:
        """Number of events in the window."""
        return len(self._live)
