"""Which events pass a filter."""

from __future__ import annotations

import numpy as np

from nvsdata.kernels.compiling import njit

NEVER = np.int64(-(2**63))  # more than 2^62 µs before all events


@njit
def after_pause(t, x, y, period, last):
    """Mask of the events at least `period` µs after the last one of their pixel that passed. O(N).

    `period` is at most 2^62; `last` int64 [H, W] are those, `NEVER` at first, and follow.
    """
    keep = np.empty(t.size, np.bool_)
    for i in range(np.uint64(t.size)):
        row, column = np.uint64(y[i]), np.uint64(x[i])
        keep[i] = last[row, column] <= t[i] - period
        if keep[i]:
            last[row, column] = t[i]
    return keep


@njit
def first_of_boxes(t, x, y, side, duration, most, box, count):
    """Mask of the first `most` events of each box of `side` x `side` pixels and `duration` µs. O(N).

    `box` int64 [rows, columns] is the number of each place's last box, `NEVER` at first, and `count` how many it kept.
    """
    keep = np.empty(t.size, np.bool_)
    for i in range(t.size):
        row, column, now = y[i] // side, x[i] // side, t[i] // duration
        if box[row, column] != now:
            box[row, column], count[row, column] = now, 0
        keep[i] = count[row, column] < most
        count[row, column] += keep[i]
    return keep


@njit
def within_rate(t, x, y, side, interval, burst, due):
    """Mask of the events by which no place exceeds a rate: one per `interval` µs, after a pause up to `burst`. O(N).

    Places have `side` x `side` pixels; `due` int64 [rows, columns] is when all that came so far would be over at this
    rate, `NEVER` at first.
    """
    keep = np.empty(t.size, np.bool_)
    for i in range(t.size):
        row, column = y[i] // side, x[i] // side
        keep[i] = due[row, column] <= t[i] + (burst - 1) * interval
        if keep[i]:
            due[row, column] = max(due[row, column], t[i]) + interval
    return keep


@njit
def in_company(t, x, y, shape, window):
    """Mask of the events up to `window` µs, at most 2^62, after one of the eight pixels around. O(N + pixels).

    `shape` is (H + 2, W + 2): a border of one pixel, so that none is outside.
    """
    # filled here, which takes half the time that numpy takes
    last, keep = np.full(shape, NEVER), np.empty(t.size, np.bool_)
    one, two = np.uint64(1), np.uint64(2)
    for i in range(np.uint64(t.size)):
        row, column = np.uint64(y[i]), np.uint64(x[i])
        above = max(last[row, column], last[row, column + one], last[row, column + two])
        beside = max(last[row + one, column], last[row + one, column + two])
        below = max(last[row + two, column], last[row + two, column + one], last[row + two, column + two])
        keep[i] = max(above, beside, below) >= t[i] - window
        last[row + one, column + one] = t[i]
    return keep


@njit
def count_into(x, y, out):
    """Add the number of events of each pixel to `out` [H, W]."""
    for i in range(np.uint64(x.size)):
        out[np.uint64(y[i]), np.uint64(x[i])] += 1


@njit
def in_rectangle(x, y, left, top, width, height):
    """Mask of the events of a rectangle of pixels. O(N)."""
    inside = np.empty(x.size, np.bool_)
    for i in range(np.uint64(x.size)):
        inside[i] = (0 <= x[i] - left < width) & (0 <= y[i] - top < height)
    return inside
