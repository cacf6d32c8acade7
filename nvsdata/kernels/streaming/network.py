"""Weights of a network for incremental inference."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from nvsdata.kernels import _native


class Layer(NamedTuple):
    """A convolution with folded normalization, and how its rows are pooled.

    - `weight` float32 [kernels + 1, in, out]: of the kernel's cells, then of the node itself; `bias` float32 [out]
    - `size`: cells of the kernel along an axis; `loops`: a node is its own neighbor; `own`: it adds its own features
    - `reach`: differences that end an axis; `signed`: of the pseudo-coordinates
    - `cluster`: width and height in pixels of the cells that rows are pooled into, None for no pooling; by their
      maximum or their `average`
    """

    weight: np.ndarray
    bias: np.ndarray
    size: int
    loops: bool
    own: bool
    reach: tuple[float, ...]
    signed: bool
    cluster: tuple[int, int] | None
    average: bool


def streaming_network(
    sensor_size: tuple[int, int],
    metric: tuple[float, float, float],
    k: int,
    layers: Sequence[Layer],
    hidden: np.ndarray,
) -> _native.StreamingNetwork:
    """Return copies of weights, which all states share.

    Args:
        sensor_size: width and height in pixels.
        metric: radius, alpha and beta, see `near_sources`; alpha must be above 0.
        k: most neighbors of an event.
        layers: one at least is pooled.
        hidden: of the first fully connected layer, float32 [cells * channels, units]; without columns if there is none.
    """
    made = _native.streaming_network(*sensor_size, *metric, k)
    for layer in layers:
        weight = layer.weight.reshape(-1, layer.weight.shape[-1])
        ends, pooling = np.array(layer.reach, np.float32), (*(layer.cluster or (0, 0)), layer.average)
        kernel = layer.size, layer.loops, layer.own, layer.signed
        _native.add_streaming_layer(made, weight, layer.bias, ends, *kernel, *pooling)
    _native.set_streaming_hidden(made, hidden)
    return made


class LiveState:
    """State of incremental inference: the rows of a network's layers for the events in the window.

    Its arrays belong to the extension, because they contain indexes into each other, which nothing else may change.

    Args:
        state: of the extension, a `SlidingNetwork` or a `CausalNetwork`.
        shape: cells and channels of its last pooled graph.
        units: of its first fully connected layer.
    """

    def __init__(self, state: Any, shape: tuple[int, int], units: int) -> None:
        self._state, self._shape, self._units = state, shape, units

    def __len__(self) -> int:
        """Return the number of events in the window."""
        return int(_native.live_size(self._state))

    @property
    def hidden(self) -> np.ndarray:
        """Sums of the first fully connected layer, without its bias: float64 [units]."""
        found = np.empty(self._units)
        _native.live_hidden(self._state, found)
        return found

    @property
    def shown(self) -> np.ndarray:
        """Features of the last graph's cells, float32 [cells, channels]."""
        found = np.empty(self._shape, np.float32)
        _native.live_shown(self._state, found)
        return found

    @property
    def products(self) -> int:
        """Multiplications so far."""
        return int(_native.live_products(self._state))
