"""Representations that are updated incrementally with the events of a stream."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import torch

from nvsdata.common.memory import check_memory, zeros
from nvsdata.data.events import LATEST, Events, check_inside, check_sensor_size
from nvsdata.kernels.represent.latest import ages_of_bins, leak_into, push_times, queue_bins

Show = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""Function that converts ages of events in µs [2, k, H, W], and a mask of the known ages, to a representation."""


class _State:
    """Base class of the states, which keep values for each pixel of a sensor.

    `update(events)` takes the next events, whose times must not go back. `tensor(at)` returns the
    representation at a time in µs, by default at the end of the last events' time, and doesn't change the state.

    Args:
        sensor_size: (width, height) in pixels.
    """

    def __init__(self, sensor_size: tuple[int, int]) -> None:
        width, height = self.sensor_size = check_sensor_size(sensor_size)
        self.shape = height, width
        self.latest: int | None = None  # µs, the end of the events so far

    def _take(self, events: Events) -> None:
        if events.sensor_size[0] > self.sensor_size[0] or events.sensor_size[1] > self.sensor_size[1]:
            raise ValueError(
                "events of {}x{} pixels, but the state has {}x{}".format(*events.sensor_size, *self.sensor_size)
            )
        check_inside(events)
        if self.latest is not None and len(events) and events.t[0] < self.latest:
            raise ValueError(f"events at {events.t[0]} µs are earlier than the state, at {self.latest} µs")
        # without events and without a stated time range, the time is unknown
        if len(events) or events.stated_end is not None:
            self.latest = events.end if self.latest is None else max(events.end, self.latest)

    def _moment(self, at: int | None) -> int:
        if at is None:
            return self.latest or 0
        if self.latest is not None and at < self.latest:
            raise ValueError(f"the state is at {self.latest} µs; its earlier value at {at} µs isn't stored")
        return at


class LatestState(_State):
    """Times of the `k` latest events of each pixel and polarity.

    Args:
        sensor_size: (width, height) in pixels.
        k: Number of events.
        show: Function from ages to the representation.
    """

    def __init__(self, sensor_size: tuple[int, int], k: int, show: Show) -> None:
        super().__init__(sensor_size)
        self._show = show
        check_memory(sensor_size, (2, k + 1, *self.shape), np.int64)
        self._times = zeros(sensor_size, (2, k, *self.shape), np.int64)
        self._counts = zeros(sensor_size, (2, *self.shape), np.int64)

    def update(self, events: Events) -> None:
        """Update the state with the next events. ValueError for a larger sensor, or if times go back."""
        self._take(events)
        push_times(*events.columns, self._times, self._counts)

    def tensor(self, at: int | None = None) -> torch.Tensor:
        """Return the representation at `at` (µs; default: end of the last events). ValueError for an earlier time."""
        k = self._times.shape[1]
        slots = np.arange(k).reshape(1, k, 1, 1)
        # the latest event first
        order = (self._counts[:, None] - 1 - slots) % k
        ages = self._moment(at) - np.take_along_axis(self._times, order, 1)
        return torch.from_numpy(self._show(ages, slots < self._counts[:, None]).astype(np.float32))


class LeakyState(_State):
    """Values that decay at a constant rate.

    Args:
        sensor_size: (width, height) in pixels.
        leak: Decrease of the values per µs.
        increment: Value that an event adds.
    """

    def __init__(self, sensor_size: tuple[int, int], leak: float, increment: float) -> None:
        super().__init__(sensor_size)
        self._leak, self._increment = float(leak), float(increment)
        # memory for the state, and for the arrays of `tensor`
        check_memory(sensor_size, (6, *self.shape), np.int64)
        self._value = zeros(sensor_size, self.shape, np.float64)
        self._since = zeros(sensor_size, self.shape, np.int64, -LATEST)

    def update(self, events: Events) -> None:
        """Update the state with the next events. ValueError for a larger sensor, or if times go back."""
        self._take(events)
        t, x, y, _ = events.columns
        leak_into(t, x, y, self._increment, self._leak, self._value, self._since)

    def tensor(self, at: int | None = None) -> torch.Tensor:
        """Return the values at `at` (µs; default: end of the last events). ValueError for an earlier time."""
        left = self._value - self._leak * (self._moment(at) - self._since).astype(np.float64)
        return torch.from_numpy(np.maximum(left, 0).astype(np.float32))[None]


class FocusState(_State):
    """Latest bins of time with events, of each pixel and polarity.

    Args:
        sensor_size: (width, height) in pixels.
        depth: Number of bins.
        duration: Duration of a bin in µs.
    """

    def __init__(self, sensor_size: tuple[int, int], depth: int, duration: int) -> None:
        super().__init__(sensor_size)
        self._duration = duration
        self._origin: int | None = None
        slots = 2, *self.shape, depth
        check_memory(sensor_size, (3, *slots), np.int64)
        bins, within = zeros(sensor_size, slots, np.int64), zeros(sensor_size, (*slots, 2), np.float64)
        self._kept = bins, within, zeros(sensor_size, slots[:3], np.int64)

    def update(self, events: Events) -> None:
        """Update the state with the next events. ValueError for a larger sensor, or if times go back."""
        self._take(events)
        if self._origin is None and self.latest is not None:
            self._origin = events.start
        if self._origin is not None:
            queue_bins(*events.columns, self._origin, self._duration, *self._kept)

    def tensor(self, at: int | None = None) -> torch.Tensor:
        """Return the representation at `at` (µs; default: end of the last events). ValueError for an earlier time."""
        depth, since = self._kept[0].shape[3], self._moment(at) - (self._origin or 0)
        out = zeros(self.sensor_size, (depth, 2, *self.shape))
        ages_of_bins(since, self._duration, *self._kept, out)
        return torch.from_numpy(out).flatten(0, 1)
