"""Order of events in time, and events chosen by a mask or by indices (select.cpp)."""

from __future__ import annotations

import numpy as np

from nvsdata.kernels import _native

MOST = 1 << 31  # number of times that is too large for indices of 32 bits


def is_sorted(t: np.ndarray) -> bool:
    """Return whether times, int64 [N], never decrease. O(N), without additional memory."""
    rises: bool = _native.is_sorted(t)
    return rises


def late(t: np.ndarray, most: int) -> np.ndarray | None:
    """Return the indices, int64, of events that come after a later event; None for more than `most` of them. O(N)."""
    found = np.empty(most + 1, np.int64)
    count = _native.late(t, found)
    return found[:count] if count <= most else None


def merge_late(late: np.ndarray, order: np.ndarray, *columns: np.ndarray) -> None:
    """Copy columns t, x, y and p to others, with late events moved to their place in time. O(N).

    A late event comes after other events of the same time. `late` int64 has the ascending indices of the late events,
    and `order` int64 the same indices in order of time. All other events must be sorted. ValueError if an index isn't
    that of an event.
    """
    _native.merge_late(late, order, *columns)


def stable_order(t: np.ndarray) -> np.ndarray:
    """Return indices int32 [N] that sort times stably by a radix sort. O(N) per 11 bits of the time span.

    `t` is int64, with fewer than 2^31 elements.
    """
    if t.size >= MOST:
        raise ValueError("too many times for indices of 32 bits")
    # memory of numpy, which asks for large pages
    orders = np.empty((2, t.size), np.int32)
    _native.stable_order(t, orders, np.empty((2, t.size), np.uint64))
    order: np.ndarray = orders[0]
    return order


def moved(t: np.ndarray, moves: np.ndarray, sigma: float, start: int, end: int) -> np.ndarray:
    """Return the times t + sigma * moves, rounded to µs and limited to `start` to `end`. `moves` is float32 [N]."""
    out = np.empty(t.size, np.int64)
    _native.moved(t, moves, sigma, start, end, out)
    return out


def copy_where(keep: np.ndarray, *columns: np.ndarray) -> None:
    """Copy the columns t, x, y and p of events at which `keep` is true to others. O(N).

    The other columns need room for one event more.
    """
    _native.copy_where(keep, *columns)


def copy_at(index: np.ndarray, *columns: np.ndarray) -> None:
    """Copy the columns t, x, y and p of events at indices, int32 or int64, to others. O(N).

    IndexError if an index isn't that of an event.
    """
    _native.copy_at(index, *columns)
