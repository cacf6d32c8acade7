"""Graph networks whose scores follow events: only rows that change are computed (thesis 6.2)."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from torch import nn

from nvsdata.common.validation import whole
from nvsdata.data.events import Events
from nvsdata.data.grid import grid_shape
from nvsdata.data.pseudo import Reach
from nvsdata.kernels.live_clusters import Cells
from nvsdata.kernels.live_layers import Features, Layer
from nvsdata.kernels.live_neighbors import Metric, Window
from nvsdata.kernels.live_pooling import Readout
from nvsdata.kernels.live_window import step
from nvsdata.kernels.marks import Marks
from nvsdata.models.fusing import fused
from nvsdata.models.graph_cnn import Activation, _GraphCNN
from nvsdata.models.pool import GraphPool, coarse_reach
from nvsdata.models.spline import SplineConv
from nvsdata.transforms.graph import RadiusGraph

LEAST = 256  # events that there is room for at first
ALWAYS = -(2**62)  # µs


def stream(model: nn.Module, window: int | None = 30_000, graph: RadiusGraph | None = None) -> Stream:
    """An object that is fed events, and has a network's scores of the last `window` µs at any moment; see `Stream`.

    - `model`: an `RGCNN` or `GCNN` of B-spline convolutions, as trained
    - `window`: µs up to the last event, its own included, whose events count (default 30,000); None for all
    - `graph`: that the network was trained with (default `RadiusGraph()`)

    ValueError for a network in training mode, or one that can't stream, by the name of its part, for graphs without
    bound in space, and for a window below 1 µs.
    """
    return Stream(model, window, graph or RadiusGraph())


class Stream:
    """A network that follows events; made by `stream`.

    Its scores are those of the network on `graph` of the events in the window, up to rounding, however events were cut.
    Memory is in proportion to the events in the window.

    - `products`: multiplications so far
    """

    def __init__(self, model: nn.Module, window: int | None, graph: RadiusGraph) -> None:
        if window is not None:
            whole("window", window, 1)
        self.window, self.graph = window, graph
        self._network = _streamable(model, graph)
        self.reset()

    def reset(self) -> None:
        """Forget all events."""
        self._last: int | None = None
        self._origin = 0
        self._state = _State(self._network, self.graph)

    def feed(self, events: Events) -> None:
        """Take events, any number, none of them before one that was fed.

        ValueError for events that fall back in time, and those of a sensor larger than the network's.
        """
        width, height = self._network.sensor_size
        if events.sensor_size[0] > width or events.sensor_size[1] > height:
            given = "x".join(map(str, events.sensor_size))
            raise ValueError(f"events of a sensor of {given}, but the network is for {width}x{height}")
        if not len(events):
            return
        first, last = int(events.t[0]), int(events.t[-1])
        if self._last is None:
            self._origin = first
        elif first < self._last:
            raise ValueError(f"events fall back in time: to {first} µs, after {self._last}")
        until = ALWAYS if self.window is None else last - self.window + 1
        kept = events.columns.take(slice(int(events.t.searchsorted(until)), None))
        self._state.step(max(until - self._origin, ALWAYS), kept._replace(t=kept.t - self._origin))
        self._last = last

    def scores(self) -> torch.Tensor:
        """Class scores (logits) float32 [num_classes] of the events in the window; without any, of an empty graph."""
        hidden = np.maximum(self._state.readout.sum + self._network.hidden_bias, 0)
        return torch.from_numpy((self._network.classify @ hidden + self._network.classify_bias).astype(np.float32))

    def __len__(self) -> int:
        """Number of events in the window."""
        return int(self._state.window.ends[1] - self._state.window.ends[0])

    @property
    def products(self) -> int:
        """Multiplications so far, in convolutions and the first fully connected layer."""
        return int(sum(layer.products[0] for layer in self._state.layers) + self._state.readout.products[0])


class _Network:
    """What a stream needs of a fused network: convolutions, how each is pooled, and the fully connected layers."""

    def __init__(self, model: _GraphCNN) -> None:
        self.sensor_size = model.sensor_size
        self.loops: list[int] = []
        self.convolutions: list[SplineConv] = []
        self.pools: list[GraphPool | None] = []
        for part in fused(model).features:
            if isinstance(part, GraphPool):
                self.pools[-1] = part
            elif not isinstance(part, Activation):
                self.convolutions.append(part.conv)
                self.loops.append(int(part.kernel.loops))
                self.pools.append(None)
        cells = model.grid[0] * model.grid[1]
        self.hidden = _array(model.hidden.weight)
        channels = self.hidden.shape[1] // cells
        self.shape = cells, channels
        self.hidden = np.ascontiguousarray(self.hidden.T)
        self.hidden_bias = _array(model.hidden.bias).astype(np.float64)
        self.classify = _array(model.classify.weight).astype(np.float64)
        self.classify_bias = _array(model.classify.bias).astype(np.float64)


def _streamable(model: nn.Module, graph: RadiusGraph) -> _Network:
    """The network's parts; ValueError, with a name, if it can't stream."""
    if not isinstance(model, _GraphCNN):
        raise ValueError(f"{type(model).__name__} can't stream: RGCNN and GCNN can")
    if model.training:
        raise ValueError("a network in training mode can't stream: call eval() first")
    for name, part in model.features.named_modules():
        conv = getattr(part, "conv", None)
        if conv is not None and not isinstance(conv, SplineConv):
            raise ValueError(f"features.{name}, a {type(conv).__name__}, can't stream: B-spline convolutions can")
    if not isinstance(graph, RadiusGraph) or graph.alpha == 0:
        raise ValueError(f"{graph} can't stream: its edges have no bound in space")
    if model.in_channels != 1:
        raise ValueError(f"the network takes {model.in_channels} features of a node; a stream has its polarity alone")
    return _Network(model)


class _State:
    """The arrays of a stream."""

    def __init__(self, network: _Network, graph: RadiusGraph) -> None:
        width, height = network.sensor_size
        side = int((graph.radius / graph.alpha**0.5) // 1)
        self.metric = Metric(graph.radius**2, float(graph.alpha), float(graph.beta), side)
        k = int(min(graph.max_degree, 2**20))
        self.window = _window(width, height, LEAST, k)
        self.near = Marks.none(width * height)
        self.plan = np.zeros((len(network.convolutions), 2), np.int64)
        reach: Reach = graph.reach(network.sensor_size)
        cells, layers, features = [], [], [_features(LEAST, 1)]
        far = (side, side)
        nodes = LEAST
        for n, (conv, loops, pool) in enumerate(zip(network.convolutions, network.loops, network.pools, strict=True)):
            layers.append(_layer(conv, loops, graph.pseudo != "abs", reach, nodes))
            if pool is None:
                self.plan[n] = -1, 0
            else:
                self.plan[n] = len(cells), pool.mode == "average"
                made, far = _cells(network.sensor_size, pool.cluster, far, nodes)
                cells.append(made)
                nodes = made.members.size
                reach = coarse_reach(reach, pool.cluster)
            features.append(_features(nodes, conv.out_channels))
        self.cells, self.layers, self.features = tuple(cells), tuple(layers), tuple(features)
        shown, total = np.zeros(network.shape, np.float32), np.zeros(network.hidden.shape[1])
        self.readout = Readout(network.hidden, shown, total, np.zeros(1, np.int64))

    def step(self, until: int, columns: Any) -> None:
        """Remove events before `until`, and append others."""
        count = int(self.window.ends[1] - self.window.ends[0]) + columns.t.size
        if count > self.window.t.size:
            self._grow(count)
        x, y = columns.x.astype(np.int32), columns.y.astype(np.int32)
        given = (2 * columns.p.astype(np.float32) - 1)[:, None]
        step(
            self.window, self.metric, self.cells, self.layers, self.features, self.plan, self.readout, self.near,
            until, columns.t, x, y, given,
        )  # fmt: skip

    def _grow(self, count: int) -> None:
        """Make room for so many events."""
        old, capacity = self.window, 1 << (count - 1).bit_length()
        window = _window(old.width, old.height, capacity, old.source.shape[1])
        numbers = np.arange(old.ends[0], old.ends[1])
        source, target = numbers & (old.t.size - 1), numbers & (capacity - 1)

        def moved(a: np.ndarray, b: np.ndarray) -> np.ndarray:
            b[target] = a[source]
            return b

        for name in ("t", "x", "y", "source", "far", "degree", "worst"):
            moved(getattr(old, name), getattr(window, name))
        for name in ("base", "room", "begin", "size", "ends"):
            getattr(window, name)[:] = getattr(old, name)
        window.slots[: old.slots.size] = old.slots
        self.window = window
        first = self.layers[0]
        rows = {name: moved(column := getattr(first, name), _wider(column, capacity)) for name in ("sum", "own", "out")}
        self.layers = (first._replace(**rows, dirty=Marks.none(capacity)), *self.layers[1:])
        events = self.features[0]
        wide = _features(capacity, events.values.shape[1])
        moved(events.values, wide.values)
        self.features = (wide, *self.features[1:])
        cells = self.cells[0]
        links = {
            name: moved(column := getattr(cells, name), _wider(column, capacity)) for name in ("after", "previous")
        }
        self.cells = (cells._replace(**links), *self.cells[1:])


def _array(parameter: torch.Tensor) -> np.ndarray:
    return parameter.detach().cpu().float().numpy()


def _wider(column: np.ndarray, size: int) -> np.ndarray:
    return np.zeros((size, *column.shape[1:]), column.dtype)


def _window(width: int, height: int, capacity: int, k: int) -> Window:
    numbers = [np.zeros(capacity, kind) for kind in (np.int64, np.int32, np.int32)]
    lists = np.zeros((capacity, k), np.int64), np.zeros((capacity, k), np.float64)
    lengths = np.zeros(capacity, np.int32), np.zeros(capacity, np.int32)
    pixels = [np.zeros(width * height, np.int64) for _ in range(4)]
    slots = np.zeros(4 * capacity + 4, np.int64)
    return Window(*numbers, *lists, *lengths, *pixels, slots, np.zeros(3, np.int64), width, height)


def _features(nodes: int, channels: int) -> Features:
    values = np.zeros((nodes, channels), np.float32)
    return Features(values, values.copy(), Marks.none(nodes))


def _layer(conv: SplineConv, loops: int, signed: bool, reach: Reach, nodes: int) -> Layer:
    weight, channels = _array(conv.weight), conv.out_channels
    root = _array(conv.root) if conv.root is not None else np.zeros((0, channels), np.float32)
    bias = _array(conv.bias) if conv.bias is not None else np.zeros(channels, np.float32)
    sums = np.zeros((nodes, channels)), np.zeros((nodes, channels)), np.zeros((nodes, channels), np.float32)
    share = np.zeros(weight.shape[:2])
    return Layer(
        weight, root, bias, conv.kernel_size, loops, signed, np.array(reach, np.float32), *sums, Marks.none(nodes),
        share, Marks.none(len(weight)), np.zeros(1, np.int64),
    )  # fmt: skip


def _cells(
    sensor_size: tuple[int, int], cluster: tuple[int, int], far: tuple[int, int], below: int
) -> tuple[Cells, tuple[int, int]]:
    """A pooled graph of `below` nodes up to `far` pixels from each other along x and y, and how far its own are."""
    columns, rows = grid_shape(sensor_size, cluster)
    across, down = (
        min((pixels + side - 1) // side, count - 1)
        for pixels, side, count in zip(far, cluster, (columns, rows), strict=True)
    )
    cells, offsets = columns * rows, (2 * across + 1) * (2 * down + 1)
    made = Cells(
        *cluster, columns, rows, across, down,
        np.zeros(cells, np.int64), *(np.zeros((cells, 3), np.int64) for _ in range(3)), np.zeros(cells, np.bool_),
        np.zeros((cells, offsets), np.int32), np.zeros((cells, offsets), np.bool_), np.full(cells, -1),
        np.full(cells, -1), np.zeros(below, np.int64), np.zeros(below, np.int64),
        Marks.none(cells), Marks.none(cells), Marks.none(cells * offsets), Marks.none(cells * offsets),
        Marks.none(cells),
    )  # fmt: skip
    return made, (across * cluster[0] + cluster[0] - 1, down * cluster[1] + cluster[1] - 1)
