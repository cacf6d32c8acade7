"""Networks for incremental inference: the layers of a model, and the features of nodes in a sliding window."""

from __future__ import annotations

from copy import deepcopy
from functools import cached_property
from typing import Any

import numpy as np
import torch
from torch import nn

from nvsdata.data.events import Columns
from nvsdata.data.graph import Graph
from nvsdata.data.grid import to_grid
from nvsdata.data.pseudo import axes
from nvsdata.kernels.streaming.causal import CausalNetwork
from nvsdata.kernels.streaming.network import Layer, streaming_network
from nvsdata.kernels.streaming.sliding import SlidingNetwork
from nvsdata.models.fusing import fused
from nvsdata.models.graph_cnn import Activation, _GraphCNN, input_of
from nvsdata.models.graph_cnn3d import RGCNN3D
from nvsdata.models.pool import GraphPool, coarse_reach
from nvsdata.models.spline import SplineConv
from nvsdata.transforms.graphs.edges import RadiusGraph

MOST_NEIGHBORS = 1_024  # largest `max_degree`; each event has memory for that many edges


class NetworkLayers:
    """Layers that incremental inference uses: convolutions, the pooling after each, and the fully connected layers.

    Args:
        model: Network in evaluation mode.
        graph: Transform that makes the edges.
        channels: Features of a node of `graph` (default 1).

    Raises:
        ValueError: For a network with a layer that can't stream (the message names it), and for graphs without bound in
            space.
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
        # the kernels compute on the CPU in single precision
        self.model = fused(deepcopy(model).cpu().float())
        self.body = getattr(self.model, which)
        self.graph, self.sensor_size = graph, model.sensor_size
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
            raise ValueError("pooling before the last block can't stream on a causal graph: set those clusters to None")
        if not graph.causal and self.pools[0] is None:
            raise ValueError("a first block without pooling can stream on a causal graph only")
        last = self.pools[-1] or next(pool for pool in self.pools[::-1] if pool is not None)
        self.grid, self.cluster = last.grid, last.cluster
        self.shape = last.grid[0] * last.grid[1], self.convolutions[-1].out_channels
        self._head = [model.hidden, model.classify] if isinstance(model, _GraphCNN) else []
        self.units = self._head[0].weight.shape[0] if self._head else 0
        self._weights = [(_array(head.weight).astype(float), _array(head.bias).astype(float)) for head in self._head]

    @property
    def has_scores(self) -> bool:
        """True if the network has fully connected layers."""
        return bool(self._weights)

    @cached_property
    def weights(self) -> Any:
        """Weights and settings in the kernels' format, shared by all incremental networks of this model."""
        layers, reach = [], self.graph.reach(self.sensor_size)
        for conv, loops, pool in zip(self.convolutions, self.loops, self.pools, strict=True):
            own = _array(conv.root) if conv.root is not None else np.zeros(conv.weight.shape[1:], np.float32)
            weight = np.concatenate((_array(conv.weight), own[None]))
            bias = _array(conv.bias) if conv.bias is not None else np.zeros(conv.out_channels, np.float32)
            kernel = conv.kernel_size, bool(loops), conv.root is not None, reach, self.graph.pseudo != "abs"
            cluster, average = (pool.cluster, pool.mode == "average") if pool else (None, False)
            layers.append(Layer(weight, bias, *kernel, cluster, average))
            reach = coarse_reach(reach, pool.cluster) if pool else reach
        metric = float(self.graph.radius), float(self.graph.alpha), float(self.graph.beta)
        hidden = _array(self._head[0].weight).T if self._head else np.zeros((0, 0), np.float32)
        return streaming_network(self.sensor_size, metric, int(self.graph.max_degree), layers, hidden)

    def scores(self, hidden: np.ndarray) -> torch.Tensor:
        """Return class scores [num_classes] from the weighted sums of the hidden layer, before bias and ReLU."""
        (_, bias), (classify, last) = self._weights
        return torch.from_numpy((classify @ np.maximum(hidden + bias, 0) + last).astype(np.float32))

    def as_grid(self, shown: np.ndarray) -> torch.Tensor:
        """Return features of cells [cells, C] as a grid, as `Graph2Grid` arranges them: [C, rows, columns]."""
        columns, rows = self.grid
        return torch.from_numpy(shown.T.reshape(-1, rows, columns).copy())

    def grid_of(self, graph: Graph) -> torch.Tensor:
        """Return the grid [C, rows, columns] of a graph, which is computed without incremental updates."""
        with torch.no_grad():
            batch = self.body(input_of(self.model, graph))
        return to_grid(batch.x, batch.pos, batch.batch, 1, 1, self.cluster, self.grid)[0, :, 0]


class IncrementalNetwork(SlidingNetwork):
    """Node features of a network for the events in a sliding window, updated as events enter and leave."""

    def __init__(self, network: NetworkLayers) -> None:
        super().__init__(network.weights, network.shape, network.units)

    def columns(self) -> Columns:
        """Return the columns of the events in the window."""
        return Columns(*self.events())


class IncrementalCausalNetwork(CausalNetwork):
    """Node features of a network on a causal graph, computed once for each event, when it arrives.

    ValueError for average pooling.
    """

    def __init__(self, network: NetworkLayers, window: int | None) -> None:
        pool = network.pools[-1]
        assert pool is not None, "the last block is pooled"
        if pool.mode != "max":
            raise ValueError(f"{pool} can't stream on a causal graph: mode 'max' can")
        super().__init__(network.weights, window, network.shape, network.units)


def _array(parameter: torch.Tensor) -> np.ndarray:
    return parameter.detach().cpu().float().numpy()
