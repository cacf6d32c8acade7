"""Weights of a network for incremental inference."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from nvsdata.kernels import _native


class Layer(NamedTuple):
    """A convolution with folded normalization, and the pooling of its rows (the features of its nodes).

    - `weight` float32 [kernels + 1, in, out]: weights of the cells of the kernel, then of the node itself
    - `bias` float32 [out]
    - `size`: number of cells of the kernel along an axis
    - `loops`: whether a node is its own neighbor; `own`: whether a node adds its own features
    - `reach`: normalization ranges of the pseudo-coordinates; `signed`: whether these are signed
    - `cluster`: width and height in pixels of the pooled cells, or None for no pooling; `average`: whether rows are
      pooled by their mean instead of their maximum
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
    """Return a network of the extension with copies of the weights, which all states share.

    Args:
        sensor_size: Width and height of the sensor in pixels.
        metric: radius, alpha and beta as in `near_sources`; alpha must be above 0.
        k: Largest number of neighbors of an event.
        layers: The convolutions, at least one of which is pooled.
        hidden: Weights of the first fully connected layer, float32 [cells * channels, units]; without columns if there
            is no such layer.
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
    """State of incremental inference: for each layer of a network, the features of the nodes in the window.

    The arrays of the state belong to the extension, because they contain indices into each other that no other code may
    change.

    Args:
        state: `SlidingNetwork` or `CausalNetwork` of the extension.
        shape: Numbers of cells and channels of the last pooled graph.
        units: Number of units of the first fully connected layer.
    """

    def __init__(self, state: Any, shape: tuple[int, int], units: int) -> None:
        self._state, self._shape, self._units = state, shape, units

    def __len__(self) -> int:
        """Return the number of events in the window."""
        return int(_native.live_size(self._state))

    @property
    def hidden(self) -> np.ndarray:
        """Sums of the first fully connected layer, without its bias, float64 [units]."""
        found = np.empty(self._units)
        _native.live_hidden(self._state, found)
        return found

    @property
    def shown(self) -> np.ndarray:
        """Features of the cells of the last pooled graph, float32 [cells, channels]."""
        found = np.empty(self._shape, np.float32)
        _native.live_shown(self._state, found)
        return found

    @property
    def products(self) -> int:
        """Number of multiplications so far."""
        return int(_native.live_products(self._state))
