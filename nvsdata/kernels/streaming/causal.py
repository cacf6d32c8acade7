"""Incremental inference on causal graphs."""

from __future__ import annotations

import numpy as np

from nvsdata.kernels import _native
from nvsdata.kernels.streaming.network import LiveState

FOREVER = 2**63 - 1  # age in µs that no event exceeds
TOGETHER = 4096  # events that are added at once, so that memory of removed events is reused


class CausalNetwork(LiveState):
    """Incremental inference on a causal graph: the features of an event are computed once, when it arrives.

    Args:
        network: Result of `streaming_network`, in which only the last layer is pooled, by maxima.
        age: Largest age of neighbors in µs, or None for any age.
        shape: Numbers of cells and channels of the pooled graph.
        units: Number of units of the first fully connected layer.
    """

    def __init__(self, network: _native.StreamingNetwork, age: int | None, shape: tuple[int, int], units: int) -> None:
        super().__init__(_native.causal_network(network, FOREVER if age is None else age), shape, units)

    def step(self, until: int, t: np.ndarray, x: np.ndarray, y: np.ndarray, p: np.ndarray) -> None:
        """Add events, and remove those before time `until`.

        Args:
            until: Time in µs.
            t: Times in µs, int64 [N], at least 0. They must not decrease, also from earlier steps.
            x: Columns, int16 [N].
            y: Rows, int16 [N].
            p: Polarities, uint8 [N], 0 or 1.

        Raises:
            ValueError: Events are out of order or outside the sensor.
            RuntimeError: An earlier step was interrupted.
        """
        _native.causal_step(self._state, until, t, x, y, p, TOGETHER)
