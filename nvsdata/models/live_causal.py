"""The arrays of a network on a causal graph, which computes a row per event and layer."""

from __future__ import annotations

from typing import Any

import numpy as np

from nvsdata.data.events import Columns
from nvsdata.kernels.live_causal import Queues, advance_causal, show_maxima
from nvsdata.kernels.live_neighbors import Metric, Window
from nvsdata.kernels.marks import Marks
from nvsdata.models.live_network import LEAST, Parts, layer_of, roomier, wider, wider_layer
from nvsdata.transforms.graph import RadiusGraph

PIECE = 4096  # events that are taken in one step
FOREVER = 2**63 - 1  # µs


class LiveCausal:
    """A network's rows for events whose neighbors are those before them.

    ValueError for average pooling.
    """

    def __init__(self, network: Parts, graph: RadiusGraph, window: int | None) -> None:
        self._age = FOREVER if window is None else window
        width, height = network.sensor_size
        self._metric = Metric.of(float(graph.radius), float(graph.alpha), float(graph.beta), max(width, height) - 1)
        self._window = Window.empty(width, height, LEAST, int(graph.max_degree))
        reach, signed = graph.reach(network.sensor_size), graph.pseudo != "abs"
        convolutions = list(zip(network.convolutions, network.loops, strict=True))
        self._layers = tuple(layer_of(conv, loops, signed, reach, LEAST) for conv, loops in convolutions)
        channels = [1, *(conv.out_channels for conv in network.convolutions)]
        self._features = tuple(np.zeros((LEAST, count), np.float32) for count in channels)
        pool = network.pools[-1]
        assert pool is not None, "the last block is pooled"
        if pool.mode != "max":
            raise ValueError(f"{pool} can't stream on a causal graph: maxima can")
        cells = pool.grid[0] * pool.grid[1]
        columns: list[Any] = [np.full(size, -1) for size in (cells, cells, cells, LEAST, LEAST)]
        columns += [np.zeros((cells, channels[-1]), np.float32), np.zeros(1, np.int64), Marks.none(cells)]
        self._queues = Queues(*pool.cluster, *pool.grid, *columns)
        self._readout = network.readout()

    def __len__(self) -> int:
        return int(self._window.ends[1] - self._window.ends[0])

    @property
    def hidden(self) -> np.ndarray:
        """Sums of the first fully connected layer, without its bias."""
        show_maxima(self._queues, self._features[-1], self._window.t.size - 1, self._readout)
        return self._readout.sum

    @property
    def shown(self) -> np.ndarray:
        """Maxima of the cells, [cells, C]."""
        show_maxima(self._queues, self._features[-1], self._window.t.size - 1, self._readout)
        return self._readout.shown

    @property
    def products(self) -> int:
        """Multiplications so far."""
        return int(sum(layer.products[0] for layer in self._layers) + self._readout.products[0])

    def step(self, until: int, columns: Columns) -> None:
        """Take events, and forget those before `until`."""
        for first in range(0, max(columns.t.size, 1), PIECE):
            some = columns.take(slice(first, first + PIECE))
            over = until if first + PIECE >= columns.t.size else -FOREVER
            # those whose last rows are still in queues, too
            count = int(self._window.ends[1] - self._queues.first[0]) + some.t.size
            if count > self._window.t.size:
                self._grow(count)
            x, y = some.x.astype(np.int32), some.y.astype(np.int32)
            given = (2 * some.p.astype(np.float32) - 1)[:, None]
            state = self._layers, self._features, self._queues
            advance_causal(self._window, self._metric, self._age, over, *state, some.t, x, y, given)

    def _grow(self, count: int) -> None:
        """Make room for so many events."""
        self._window, moved = roomier(self._window, count)
        capacity = self._window.t.size
        self._layers = tuple(wider_layer(layer, capacity, moved) for layer in self._layers)
        self._features = tuple(moved(values, wider(values, capacity)) for values in self._features)
        after, previous = (moved(c, wider(c, capacity)) for c in (self._queues.after, self._queues.previous))
        self._queues = self._queues._replace(after=after, previous=previous)
