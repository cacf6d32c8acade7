"""Network on causal graphs that follows events."""

from __future__ import annotations

import numpy as np

from nvsdata.kernels import _native
from nvsdata.kernels.streaming.network import LiveState

FOREVER = 2**63 - 1  # µs
TOGETHER = 4096  # events that are taken at once, so that rows of those that have gone are used again


class CausalNetwork(LiveState):
    """A network's rows for events whose neighbors are those before them: a row is computed once, when its event comes.

    Args:
        network: see `streaming_network`; only its last layer is pooled, by maxima.
        age: µs up to an event from which its neighbors come, None for all before.
        shape: cells and channels of the pooled graph.
        units: of its first fully connected layer.
    """

    def __init__(self, network: _native.StreamingNetwork, age: int | None, shape: tuple[int, int], units: int) -> None:
        super().__init__(_native.causal_network(network, FOREVER if age is None else age), shape, units)

    def step(self, until: int, t: np.ndarray, x: np.ndarray, y: np.ndarray, p: np.ndarray) -> None:
        """Take events, and forget those before time `until`.

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
