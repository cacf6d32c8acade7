"""Incremental inference on a sliding window."""

from __future__ import annotations

import numpy as np

from nvsdata.kernels import _native
from nvsdata.kernels.streaming.network import LiveState


class SlidingNetwork(LiveState):
    """Incremental inference on a sliding window: only the node features that change are computed.

    Args:
        network: Result of `streaming_network`, in which the first layer is pooled.
        shape: Numbers of cells and channels of the last pooled graph.
        units: Number of units of the first fully connected layer.
    """

    def __init__(self, network: _native.StreamingNetwork, shape: tuple[int, int], units: int) -> None:
        super().__init__(_native.sliding_network(network), shape, units)

    def step(self, until: int, t: np.ndarray, x: np.ndarray, y: np.ndarray, p: np.ndarray) -> None:
        """Remove events before time `until`, and append others.

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
        _native.sliding_step(self._state, until, t, x, y, p)

    def count_before(self, until: int) -> int:
        """Return the number of events in the window before time `until` (µs)."""
        return int(_native.sliding_count_before(self._state, until))

    def events(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Return t, x, y and p of the events in the window."""
        n = len(self)
        found = np.empty(n, np.int64), np.empty(n, np.int16), np.empty(n, np.int16), np.empty(n, np.uint8)
        _native.sliding_events(self._state, *found)
        return found
