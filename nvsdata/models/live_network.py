"""The arrays of a graph network that follows events, and the step that brings them up to date."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable
from copy import deepcopy
from typing import Any

import numpy as np
import torch
from torch import nn

from nvsdata.data.events import Columns
from nvsdata.data.graph import Graph
from nvsdata.data.grid import grid_shape, to_grid
from nvsdata.data.pseudo import Reach, axes
from nvsdata.kernels.live_clusters import Cells
from nvsdata.kernels.live_layers import TOGETHER, Features, Layer
from nvsdata.kernels.live_neighbors import Metric, Window
from nvsdata.kernels.live_pooling import Readout
from nvsdata.kernels.live_window import step
from nvsdata.kernels.marks import Marks
from nvsdata.models.fusing import fused
from nvsdata.models.graph_cnn import Activation, _GraphCNN, input_of
from nvsdata.models.graph_cnn3d import RGCNN3D
from nvsdata.models.pool import GraphPool, coarse_reach
from nvsdata.models.spline import SplineConv
from nvsdata.transforms.graph import RadiusGraph

LEAST = 256  # events that there is room for at first
MOST_NEIGHBORS = 1_024  # of a node; each event has room for all


class Parts:
    """What following events needs of a network: convolutions, how each is pooled, and the fully connected layers.

    - `channels`: features of a node of `graph`

    ValueError, with the name of a part, for a network that can't, and for graphs without bound in space.
    """

    def __init__(self, model: nn.Module, graph: Any, channels: int = 1) -> None:
        if not isinstance(model, _GraphCNN | RGCNN3D):
            raise ValueError(f"{type(model).__name__} can't stream: RGCNN and GCNN can, and the graph part of RGCNN3D")
        if model.training:
            raise ValueError("a network in training mode can't stream: call eval() first")
        which = "features" if isinstance(model, _GraphCNN) else "spatial"
        for name, part in getattr(model, which).named_modules():
            conv = getattr(part, "conv", None)
            if conv is not None and not isinstance(conv, SplineConv):
                raise ValueError(f"{which}.{name}, a {type(conv).__name__}, can't stream: B-spline convolutions can")
        if not isinstance(graph, RadiusGraph) or graph.alpha == 0:
            raise ValueError(f"{graph} can't stream: its edges have no bound in space")
        if graph.max_degree > MOST_NEIGHBORS:
            raise ValueError(f"{graph} can't stream: max_degree must be at most {MOST_NEIGHBORS:,}")
        if model.in_channels != channels:
            has = "its polarity alone" if channels == 1 else f"{channels} on the given graph"
            raise ValueError(f"the network takes {model.in_channels} features of a node; a stream has {has}")
        if (given := axes(graph.pseudo)) != model.dim:
            raise ValueError(f"edges of {graph} have {given} pseudo-coordinates, but the network takes {model.dim}")
        # the kernels' own device and precision
        self.model = fused(deepcopy(model).cpu().float())
        self.body = getattr(self.model, which)
        self.sensor_size = model.sensor_size
        self.loops: list[int] = []
        self.convolutions: list[SplineConv] = []
        self.pools: list[GraphPool | None] = []
        layer: Any
        for layer in self.body:
            if isinstance(layer, GraphPool):
                self.pools[-1] = layer
            elif not isinstance(layer, Activation):
                self.convolutions.append(layer.conv)
                self.loops.append(int(layer.kernel.loops))
                self.pools.append(None)
        if graph.causal and any(self.pools[:-1]):
            raise ValueError("pooling before the last block can't stream on a causal graph: clusters of None can")
        if not graph.causal and self.pools[0] is None:
            raise ValueError("a first block without pooling can't stream, but on a causal graph")
        last = self.pools[-1] or next(pool for pool in self.pools[::-1] if pool is not None)
        self.grid, self.cluster = last.grid, last.cluster
        self.shape = last.grid[0] * last.grid[1], self.convolutions[-1].out_channels
        self._head = [model.hidden, model.classify] if isinstance(model, _GraphCNN) else []
        rows = self._head[0].weight.shape[0] if self._head else 0
        self.hidden = np.ascontiguousarray(_array(self._head[0].weight).T) if rows else np.zeros((0, 0), np.float32)
        self._weights = [(_array(head.weight).astype(float), _array(head.bias).astype(float)) for head in self._head]

    @property
    def has_scores(self) -> bool:
        """Whether there are fully connected layers."""
        return bool(self._weights)

    def readout(self) -> Readout:
        """The first fully connected layer, of no features."""
        sums = np.zeros(self.shape, np.float32), np.zeros(self.hidden.shape[1])
        return Readout(self.hidden, *sums, np.zeros(1, np.int64))

    def scores(self, hidden: np.ndarray) -> torch.Tensor:
        """Class scores from the sums of the hidden layer."""
        (_, bias), (classify, last) = self._weights
        return torch.from_numpy((classify @ np.maximum(hidden + bias, 0) + last).astype(np.float32))

    def as_grid(self, shown: np.ndarray) -> torch.Tensor:
        """Features of cells [cells, C] as Graph2Grid has them, [C, rows, columns]."""
        columns, rows = self.grid
        return torch.from_numpy(shown.T.reshape(-1, rows, columns).copy())

    def grid_of(self, graph: Graph) -> torch.Tensor:
        """The same of a graph, computed as a whole."""
        with torch.no_grad():
            batch = self.body(input_of(self.model, graph))
        return to_grid(batch.x, batch.pos, batch.batch, 1, 1, self.cluster, self.grid)[0, :, 0]


class LiveNetwork:
    """A network's rows for the events in a window that slides.

    - `hidden` float64 [hidden]: sums of the first fully connected layer, without its bias
    - `products`: multiplications so far
    """

    def __init__(self, network: Parts, graph: RadiusGraph) -> None:
        width, height = network.sensor_size
        self._metric = Metric.of(float(graph.radius), float(graph.alpha), float(graph.beta), max(width, height) - 1)
        side = int(self._metric.offsets.max())
        self._window = Window.empty(width, height, LEAST, int(graph.max_degree))
        self._origin = 0
        self._near = Marks.none(width * height)
        self._plan = np.zeros((len(network.convolutions), 2), np.int64)
        reach: Reach = graph.reach(network.sensor_size)
        cells: list[Cells] = []
        layers: list[Layer] = []
        features = [_features(LEAST, 1)]
        far = (side, side)
        nodes = LEAST
        for n, (conv, loops, pool) in enumerate(zip(network.convolutions, network.loops, network.pools, strict=True)):
            layers.append(layer_of(conv, loops, graph.pseudo != "abs", reach, nodes))
            if pool is None:
                self._plan[n] = -1, 0
            else:
                self._plan[n] = len(cells), pool.mode == "average"
                made, far = _cells(network.sensor_size, pool.cluster, far, nodes, axes(graph.pseudo))
                cells.append(made)
                nodes = made.members.size
                reach = coarse_reach(reach, pool.cluster)
            features.append(_features(nodes, conv.out_channels))
        self._cells, self._layers, self._features = tuple(cells), tuple(layers), tuple(features)
        self._readout = network.readout()

    def __len__(self) -> int:
        return int(self._window.ends[1] - self._window.ends[0])

    @property
    def hidden(self) -> np.ndarray:
        return self._readout.sum

    @property
    def shown(self) -> np.ndarray:
        """Features of the last graph's cells, [cells, C]."""
        return self._readout.shown

    @property
    def products(self) -> int:
        return int(sum(layer.products[0] for layer in self._layers) + self._readout.products[0])

    def _rows(self) -> np.ndarray:
        """The rows of the events, in order."""
        rows: np.ndarray = np.arange(self._window.ends[0], self._window.ends[1]) & (self._window.t.size - 1)
        return rows

    def over(self, until: int) -> int:
        """How many events are before `until`."""
        first, last = (int(end) for end in self._window.ends[:2])
        until -= self._origin
        t, mask = self._window.t, self._window.t.size - 1
        return bisect_left(range(first, last), until, key=lambda number: t[number & mask])

    def columns(self) -> Columns:
        """The events."""
        rows, window = self._rows(), self._window
        p = self._features[0].values[rows, 0] > 0
        x, y = window.x[rows].astype(np.int16), window.y[rows].astype(np.int16)
        return Columns(window.t[rows] + self._origin, x, y, p.astype(np.uint8))

    def step(self, until: int, columns: Columns) -> None:
        """Remove events before `until`, and append others."""
        if columns.t.size and self.over(until) == len(self):
            # times begin anew where they may, so that their sums stay small
            self._step(until, columns.first(0))
            self._origin = int(columns.t[0])
        self._step(until, columns)

    def _step(self, until: int, columns: Columns) -> None:
        count = len(self) + columns.t.size
        if count > self._window.t.size:
            self._grow(count)
        x, y = columns.x.astype(np.int32), columns.y.astype(np.int32)
        given = (2 * columns.p.astype(np.float32) - 1)[:, None]
        state = self._cells, self._layers, self._features, self._plan, self._readout, self._near
        until = max(until - self._origin, -(2**62))
        step(self._window, self._metric, *state, until, columns.t - self._origin, x, y, given)

    def _grow(self, count: int) -> None:
        """Make room for so many events."""
        old = self._window
        self._window, moved = roomier(old, count)
        capacity = self._window.t.size
        first, cells, events = self._layers[0], self._cells[0], self._features[0]
        self._layers = (wider_layer(first, capacity, moved), *self._layers[1:])
        wide = _features(capacity, events.values.shape[1])
        moved(events.values, wide.values)
        self._features = (wide, *self._features[1:])
        links: dict[str, Any] = {n: moved(c := getattr(cells, n), wider(c, capacity)) for n in ("after", "previous")}
        self._cells = (cells._replace(**links), *self._cells[1:])


Moved = Callable[[np.ndarray, np.ndarray], np.ndarray]


def roomier(old: Window, count: int) -> tuple[Window, Moved]:
    """A window with room for so many events, and what copies rows of events into columns of its size."""
    capacity = 1 << (count - 1).bit_length()
    window = Window.empty(old.width, old.height, capacity, old.source.shape[1])
    # the rows of all numbers that were used, because those that have gone may still be asked for
    numbers = np.arange(max(int(old.ends[1]) - old.t.size, 0), old.ends[1])
    source, target = numbers & (old.t.size - 1), numbers & (capacity - 1)

    def moved(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        b[target] = a[source]
        return b

    for name in ("t", "x", "y", "source", "far", "degree", "worst"):
        moved(getattr(old, name), getattr(window, name))
    for name in ("base", "room", "begin", "size", "ends"):
        getattr(window, name)[:] = getattr(old, name)
    window.slots[: old.slots.size] = old.slots
    return window, moved


def wider_layer(layer: Layer, capacity: int, moved: Moved) -> Layer:
    """A layer of events with room for more."""
    names = ("sums", "out", "degree", "age")
    rows: dict[str, Any] = {name: moved(column := getattr(layer, name), wider(column, capacity)) for name in names}
    return layer._replace(**rows | {"dirty": Marks.none(capacity)})


def _array(parameter: torch.Tensor) -> np.ndarray:
    return parameter.detach().cpu().float().numpy()


def wider(column: np.ndarray, size: int) -> np.ndarray:
    """A column of zeros of another length."""
    return np.zeros((size, *column.shape[1:]), column.dtype)


def _features(nodes: int, channels: int) -> Features:
    values = np.zeros((nodes, channels), np.float32)
    return Features(values, values.copy(), Marks.none(nodes))


def layer_of(conv: SplineConv, loops: int, signed: bool, reach: Reach, nodes: int) -> Layer:
    """A convolution of so many nodes."""
    weight, channels = _array(conv.weight), conv.out_channels
    own = _array(conv.root) if conv.root is not None else np.zeros(weight.shape[1:], np.float32)
    weight = np.concatenate((weight, own[None]))
    bias = _array(conv.bias) if conv.bias is not None else np.zeros(channels, np.float32)
    return Layer(
        weight, bias, conv.kernel_size, loops, int(conv.root is not None), signed, np.array(reach, np.float32),
        np.zeros((nodes, 2, channels)), np.zeros((nodes, channels), np.float32), np.zeros(nodes, np.int64),
        np.zeros(nodes, np.int64), Marks.none(nodes), np.zeros((TOGETHER, *weight.shape[:2]), np.float32),
        np.zeros((TOGETHER, len(weight)), np.bool_), np.zeros((TOGETHER, 2, channels), np.float32),
        np.zeros(1, np.int64),
    )  # fmt: skip


def _cells(
    sensor_size: tuple[int, int], cluster: tuple[int, int], far: tuple[int, int], below: int, axes: int
) -> tuple[Cells, tuple[int, int]]:
    """A pooled graph of `below` nodes up to `far` pixels apart along x and y, and how far its own are."""
    columns, rows = grid_shape(sensor_size, cluster)
    across, down = (
        min((pixels + side - 1) // side, count - 1)
        for pixels, side, count in zip(far, cluster, (columns, rows), strict=True)
    )
    cells, offsets = columns * rows, (2 * across + 1) * (2 * down + 1)
    state: list[Any] = [np.zeros(cells, np.int64), *np.zeros((3, cells, 3), np.int64), np.zeros(cells, np.bool_)]
    state += [np.zeros((cells, offsets), np.int32), np.zeros((cells, offsets), np.bool_)]
    state += [np.full(cells, -1), np.full(cells, -1), *np.zeros((2, below), np.int64)]
    state += [Marks.none(cells * each) for each in (1, 1, offsets, offsets, 1)]
    made = Cells(*cluster, columns, rows, across, down, axes, *state)
    return made, (across * cluster[0] + cluster[0] - 1, down * cluster[1] + cluster[1] - 1)
