"""Incremental inference on causal graphs."""

from __future__ import annotations

import numpy as np

from nvsdata.kernels import _native
from nvsdata.kernels.streaming.network import LiveState

FOREVER = 2**63 - 1  # µs
TOGETHER = 4096  # events that are taken at once, so that rows of those that have gone are used again


class CausalNetwork(LiveState):
    """Rows of a network on a causal graph: the rows of an event are computed once, when it arrives.

    Args:
        network: see `streaming_network`; only its last layer is pooled, by maxima.
        age: Largest age in µs of an event's neighbors, None for any age.
        shape: cells and channels of the pooled graph.
        units: of its first fully connected layer.
    """

    def __init__(self, network: _native.StreamingNetwork, age: int | None, shape: tuple[int, int], units: int) -> None:
        super().__init__(_native.causal_network(network, FOREVER if age is None else age), shape, units)

    def step(self, until: int, t: np.ndarray, x: np.ndarray, y: np.ndarray, p: np.ndarray) -> None:
        """Add events, and remove those before time `until`.

        Args:
            until: µs.
            t: int64 [N], from 0 on; not before events that were taken earlier.
            x: int16 [N].
            y: int16 [N].
            p: uint8 [N], 0 or 1.

        Raises:
            ValueError: events out of order or outside the sensor.
            RuntimeError: an earlier step was interrupted.
        """
        _native.causal_step(self._state, until, t, x, y, p, TOGETHER)
