"""Masks of the events that pass a filter. Events outside the arrays of pixels or boxes raise an IndexError."""

from __future__ import annotations

import numpy as np

from nvsdata.kernels import _native

NEVER = np.int64(-(2**63))  # more than 2^62 µs before all events
LARGEST = 32_768  # pixels along an axis; a box of this side covers any sensor


def not_refractory(t: np.ndarray, x: np.ndarray, y: np.ndarray, period: int, last: np.ndarray) -> np.ndarray:
    """Return the mask of the events at least `period` µs after the last kept event of their pixel. O(N).

    `period` is at most 2^62. `last` int64 [H, W] has the time of the last kept event of each pixel, or `NEVER` if there
    is none yet. It is updated.
    """
    keep = np.empty(t.size, np.bool_)
    _native.not_refractory(t, x, y, period, last, keep)
    return keep


def first_of_boxes(
    t: np.ndarray,
    x: np.ndarray,
    y: np.ndarray,
    side: int,
    duration: int,
    most: int,
    box: np.ndarray,
    count: np.ndarray,
) -> np.ndarray:
    """Return the mask of the first `most` events of each box of `side` x `side` pixels and `duration` µs. O(N).

    Boxes at the same position are numbered by time. `box` int64 [rows, columns] has the number of the latest box at
    each position, or `NEVER` if there is none yet. `count` has the number of kept events of this box. Both are updated.
    """
    keep = np.empty(t.size, np.bool_)
    _native.first_of_boxes(t, x, y, min(side, LARGEST), duration, most, box, count, keep)
    return keep


def within_rate(
    t: np.ndarray, x: np.ndarray, y: np.ndarray, side: int, interval: int, burst: int, due: np.ndarray
) -> np.ndarray:
    """Return the mask of the events that don't exceed a rate in their cell. O(N).

    The rate is one event per `interval` µs. After a pause, up to `burst` events may follow each other faster. Cells
    have `side` x `side` pixels. `due` int64 [rows, columns] has the time at which the kept events of each cell would
    end if they came at exactly this rate, or `NEVER` if there are none yet. It is updated.
    """
    keep = np.empty(t.size, np.bool_)
    _native.within_rate(t, x, y, min(side, LARGEST), interval, burst, due, keep)
    return keep


def supported_by_neighbors(
    t: np.ndarray, x: np.ndarray, y: np.ndarray, shape: tuple[int, int], window: int
) -> np.ndarray:
    """Return the mask of the events with an event at one of eight neighboring pixels at most `window` µs earlier.

    O(N + pixels). `window` is at most 2^62. `shape` is (H + 2, W + 2), because a border makes all neighbors valid.
    """
    keep = np.empty(t.size, np.bool_)
    _native.supported_by_neighbors(t, x, y, *shape, window, keep)
    return keep


def count_into(x: np.ndarray, y: np.ndarray, out: np.ndarray) -> None:
    """Add the number of events of each pixel to `out` int64 [H, W]. O(N)."""
    _native.count_into(x, y, out)


def in_rectangle(x: np.ndarray, y: np.ndarray, left: int, top: int, width: int, height: int) -> np.ndarray:
    """Return the mask of the events in a rectangle of pixels. O(N)."""
    inside = np.empty(x.size, np.bool_)
    _native.in_rectangle(x, y, left, top, left + width - 1, top + height - 1, inside)
    return inside
