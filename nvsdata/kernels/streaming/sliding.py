"""Network that follows the events in a window that slides."""

from __future__ import annotations

import numpy as np

from nvsdata.kernels import _native
from nvsdata.kernels.streaming.network import LiveState


class SlidingNetwork(LiveState):
    """A network's rows for the events in a window that slides: only rows that change are computed.

    Args:
        network: see `streaming_network`; its first layer is pooled.
        shape: cells and channels of its last pooled graph.
        units: of its first fully connected layer.
    """

    def __init__(self, network: _native.StreamingNetwork, shape: tuple[int, int], units: int) -> None:
        super().__init__(_native.sliding_network(network), shape, units)

    def step(self, until: int, t: np.ndarray, x: np.ndarray, y: np.ndarray, p: np.ndarray) -> None:
        """Remove events before time `until`, and append others.

        Args:
            until: µs.
            t: int64 [N], from 0 on; not before events that were appended earlier.
            x: int16 [N].
            y: int16 [N].
            p: uint8 [N], 0 or 1.

        Raises:
            ValueError: events out of order or outside the sensor.
            RuntimeError: an earlier step was interrupted.
        """
        _native.sliding_step(self._state, until, t, x, y, p)

    def count_before(self, until: int) -> int:
        """Return the number of events before time `until`."""
        return int(_native.sliding_count_before(self._state, until))

    def events(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Return t, x, y and p of the events."""
        n = len(self)
        found = np.empty(n, np.int64), np.empty(n, np.int16), np.empty(n, np.int16), np.empty(n, np.uint8)
        _native.sliding_events(self._state, *found)
        return found
