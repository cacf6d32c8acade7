"""Order of events in time, and events chosen by a mask or by indices (select.cpp)."""

from __future__ import annotations

import numpy as np

from nvsdata.kernels import _native

MOST = 1 << 31  # times that indices of 32 bits don't number


def is_sorted(t: np.ndarray) -> bool:
    """Return whether no time, int64 [N], is smaller than the one before it. O(N), no memory."""
    rises: bool = _native.is_sorted(t)
    return rises


def late(t: np.ndarray, most: int) -> np.ndarray | None:
    """Return indices int64 of the events that come after one with a later time; None if more than `most`. O(N)."""
    found = np.empty(most + 1, np.int64)
    count = _native.late(t, found)
    return found[:count] if count <= most else None


def merge_late(late: np.ndarray, order: np.ndarray, *columns: np.ndarray) -> None:
    """Copy columns t, x, y, p to others, with `late` events sorted in, after other events of the same time. O(N).

    `late` and `order` int64 are the same indices, ascending and in order of time. All other events must be sorted.
    ValueError for indices of no event.
    """
    _native.merge_late(late, order, *columns)


def stable_order(t: np.ndarray) -> np.ndarray:
    """Return indices int32 [N] that sort times stably. O(N) per 11 bits of their span.

    A radix sort. `t` is int64, with fewer than 2^31 elements.
    """
    if t.size >= MOST:
        raise ValueError("too many times for indices of 32 bits")
    # memory of numpy, which asks for large pages
    orders = np.empty((2, t.size), np.int32)
    _native.stable_order(t, orders, np.empty((2, t.size), np.uint64))
    order: np.ndarray = orders[0]
    return order


def moved(t: np.ndarray, moves: np.ndarray, sigma: float, start: int, end: int) -> np.ndarray:
    """Return times plus `sigma` times `moves` float32 [N], rounded to µs, not before `start` or after `end`."""
    out = np.empty(t.size, np.int64)
    _native.moved(t, moves, sigma, start, end, out)
    return out


def copy_where(keep: np.ndarray, *columns: np.ndarray) -> None:
    """Copy the events, columns t, x, y, p, at which `keep` is true to others, which need room for one more. O(N)."""
    _native.copy_where(keep, *columns)


def copy_at(index: np.ndarray, *columns: np.ndarray) -> None:
    """Copy the events, columns t, x, y, p, at indices, int32 or int64, to others. O(N).

    IndexError for an index of no event.
    """
    _native.copy_at(index, *columns)
