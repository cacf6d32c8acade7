"""The neighbors of events in a window that slides: lists that are those of `near_sources` after every step.

Events have numbers in the order in which they come; an event's row is its number modulo the capacity. Each pixel has
its events' numbers in a row, so that those next to a time are found by halving. An event that comes can be among the
`k` nearest only of the newest `k` events of a pixel, and one that goes only of the oldest `k`, because events of a
pixel are nearer to each other: so a step looks at `k` events of each pixel near it, however many there are.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from nvsdata.kernels.compiling import njit


class Metric(NamedTuple):
    """How far events are from each other: see `near_sources`; `side` is the farthest along an axis, in pixels."""

    limit: float
    alpha: float
    beta: float
    side: int


class Window(NamedTuple):
    """Events and their neighbors.

    - `t` int64, `x`, `y` int32 [capacity]: by row; the capacity is a power of two
    - `source` int64, `far` float64 [capacity, k]: numbers of each one's neighbors and their squared distances, of which
      the first `degree` int32 [capacity] count, and `worst` int32 [capacity] is the place of the farthest
    - `base`, `room`, `begin`, `size` int64 [pixels]: where in `slots` a pixel has room, and its events
    - `slots` int64 [4 capacity + 4]: numbers of the pixels' events, ascending
    - `ends` int64 [3]: number of the first event, that of the next one, and end of the room given to pixels
    - `width`, `height`: of the sensor
    """

    t: np.ndarray
    x: np.ndarray
    y: np.ndarray
    source: np.ndarray
    far: np.ndarray
    degree: np.ndarray
    worst: np.ndarray
    base: np.ndarray
    room: np.ndarray
    begin: np.ndarray
    size: np.ndarray
    slots: np.ndarray
    ends: np.ndarray
    width: int
    height: int


@njit(inline="always")
def row_of(window, number):
    """The row of an event."""
    return number & (window.t.size - 1)


@njit
def push(window, number, t, x, y):
    """Append an event, without neighbors."""
    row = row_of(window, number)
    window.t[row], window.x[row], window.y[row], window.degree[row] = t, x, y, 0
    pixel = y * window.width + x
    base, begin, size = window.base[pixel], window.begin[pixel], window.size[pixel]
    if begin + size == base + window.room[pixel]:
        if 2 * size >= window.room[pixel]:
            need = 2 * size + 2
            if window.ends[2] + need > window.slots.size:
                _repack(window)
                begin = window.begin[pixel]
            base = window.ends[2]
            window.ends[2] += need
            window.base[pixel], window.room[pixel] = base, need
        for n in range(size):
            window.slots[base + n] = window.slots[begin + n]
        window.begin[pixel] = begin = base
    window.slots[begin + size] = number
    window.size[pixel] += 1
    window.ends[1] = number + 1


@njit
def _repack(window):
    """Give each pixel twice the room that it needs."""
    old, at = window.slots.copy(), 0
    for pixel in range(window.base.size):
        begin, size = window.begin[pixel], window.size[pixel]
        window.slots[at : at + size] = old[begin : begin + size]
        window.base[pixel] = window.begin[pixel] = at
        window.room[pixel] = 2 * size
        at += 2 * size
    window.ends[2] = at


@njit
def pop(window):
    """Remove the oldest event from its pixel; its row stays until it is written anew."""
    row = row_of(window, window.ends[0])
    pixel = window.y[row] * window.width + window.x[row]
    window.begin[pixel] += 1
    window.size[pixel] -= 1
    window.ends[0] += 1


@njit
def search(window, number, metric):
    """Find the neighbors of an event anew. O(pixels within the radius · k)."""
    row = row_of(window, number)
    window.degree[row] = 0
    t, x, y = window.t[row], window.x[row], window.y[row]
    for v in range(max(y - metric.side, 0), min(y + metric.side + 1, window.height)):
        for u in range(max(x - metric.side, 0), min(x + metric.side + 1, window.width)):
            pixel = v * window.width + u
            base = metric.alpha * ((u - x) * (u - x) + (v - y) * (v - y))
            if window.size[pixel] and base <= metric.limit:
                _look(window, number, row, t, pixel, base, metric)


@njit
def _look(window, number, row, t, pixel, base, metric):
    """Offer an event those of a pixel: newer ones outward, then older ones by runs of equal times."""
    first = window.begin[pixel]
    end = first + window.size[pixel]
    at = _first_from(window.slots, first, end, number)
    for n in range(at, end):
        other = window.slots[n]
        if other != number and not offer(window, row, other, t, base, metric):
            break
    last = at
    while last > first:
        # the run of those at one time, from its first on
        time = window.t[row_of(window, window.slots[last - 1])]
        run = _first_at(window, first, last, time)
        for n in range(run, last):
            if not offer(window, row, window.slots[n], t, base, metric):
                return
        last = run


@njit
def _first_from(slots, first, end, number):
    """Place of the first number from `number` on."""
    while first < end:
        middle = (first + end) // 2
        if slots[middle] < number:
            first = middle + 1
        else:
            end = middle
    return first


@njit
def _first_at(window, first, last, time):
    """Place of the first event at `time`, which the one before `last` has. Near ones are tried first."""
    step = 1
    low = last - 1
    while low - step >= first and window.t[row_of(window, window.slots[low - step])] == time:
        low -= step
        step *= 2
    first = max(first, low - step)
    while first < low:
        middle = (first + low) // 2
        if window.t[row_of(window, window.slots[middle])] < time:
            first = middle + 1
        else:
            low = middle
    return first


@njit
def offer(window, row, other, t, base, metric):
    """Take an event as a neighbor if it is among the nearest; returns whether it is."""
    gap = abs(window.t[row_of(window, other)] - t)
    far = base + metric.beta * (np.float64(gap) * np.float64(gap))
    k, degree, worst = window.source.shape[1], window.degree[row], window.worst[row]
    if far > metric.limit:
        return False
    if degree < k:
        window.source[row, degree], window.far[row, degree] = other, far
        window.degree[row] = degree + 1
        if degree == 0 or _comes_after(window, row, t, degree, worst):
            window.worst[row] = degree
        return True
    here = window.far[row, worst]
    if far > here:
        return False
    if far == here:
        last = window.source[row, worst]
        apart = abs(window.t[row_of(window, last)] - t)
        if gap > apart or (gap == apart and other > last):
            return False
    window.source[row, worst], window.far[row, worst] = other, far
    farthest(window, row, t)
    return True


@njit
def farthest(window, row, t):
    """Find the farthest neighbor of a row."""
    worst = 0
    for n in range(1, window.degree[row]):
        if _comes_after(window, row, t, n, worst):
            worst = n
    window.worst[row] = worst


@njit
def _comes_after(window, row, t, a, b):
    """Whether a neighbor is farther than another: of equals the one farther in time, then the one that came later."""
    if window.far[row, a] != window.far[row, b]:
        return window.far[row, a] > window.far[row, b]
    first, second = window.source[row, a], window.source[row, b]
    apart, other = abs(window.t[row_of(window, first)] - t), abs(window.t[row_of(window, second)] - t)
    return apart > other or (apart == other and first > second)
