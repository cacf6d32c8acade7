"""Weights of a network that follows events."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

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
