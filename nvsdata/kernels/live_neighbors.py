"""The neighbors of events in a window that slides: lists that are those of `near_sources` after every step.

Events have numbers in the order in which they come; an event's row is its number modulo the capacity. Each pixel has
its events' numbers in a row, so that those next to a time are found by halving. An event that comes can be among the
`k` nearest only of the newest `k` events of a pixel, and one that goes only of the oldest `k`, because events of a
pixel are nearer to each other: so a step looks at `k` events of each pixel near it, however many there are.
"""

from __future__ import annotations

from typing import Any, NamedTuple, Self

import numpy as np

from nvsdata.kernels.compiling import njit


class Metric(NamedTuple):
    """How far events are from each other: see `near_sources`.

    - `radius`, `alpha`, `beta`; `limit`: largest squared distance
    - `offsets` int64 [M, 2]: x and y from an event to the pixels within it, nearest first; `apart` float64 [M]: alpha
      times their squared distance
    """

    radius: float
    alpha: float
    beta: float
    limit: float
    offsets: np.ndarray
    apart: np.ndarray

    @classmethod
    def of(cls, radius: float, alpha: float, beta: float, most: int) -> Self:
        """The metric of a graph whose nodes are at most so many pixels apart along an axis; `alpha` must be above 0."""
        # one more, because the quotient may be rounded down
        side = int(min(radius / alpha**0.5 + 1, most))
        y, x = np.mgrid[-side : side + 1, -side : side + 1].reshape(2, -1)
        order = np.argsort(x * x + y * y, kind="stable")
        offsets, apart = np.stack((x, y), 1)[order], (alpha * (x * x + y * y))[order]
        near = apart <= radius * radius
        return cls(radius, alpha, beta, radius * radius, offsets[near].astype(np.int64), apart[near].astype(np.float64))


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

    @classmethod
    def empty(cls, width: int, height: int, capacity: int, k: int) -> Self:
        """No event, of a sensor of `width` x `height`, and room for so many of `k` neighbors."""
        columns: list[Any] = [np.zeros(capacity, kind) for kind in (np.int64, np.int32, np.int32)]
        columns += [np.zeros((capacity, k), np.int64), np.zeros((capacity, k)), *np.zeros((2, capacity), np.int32)]
        columns += [*np.zeros((4, width * height), np.int64), np.zeros(4 * capacity + 4, np.int64)]
        return cls(*columns, np.zeros(3, np.int64), width, height)


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
    """Find the neighbors of an event anew. O(pixels up to the farthest neighbor · k)."""
    lists, slots, mask = lists_of(window), window.slots, window.t.size - 1
    row, k = number & mask, window.source.shape[1]
    degree, far, worst = window.degree, window.far, window.worst
    offsets, apart, limit, beta = metric.offsets, metric.apart, metric.limit, metric.beta
    begin, size = window.begin, window.size
    degree[row] = 0
    x, y = window.x[row], window.y[row]
    for n in range(apart.size):
        if degree[row] == k and apart[n] > far[row, worst[row]]:
            break
        u, v = x + offsets[n, 0], y + offsets[n, 1]
        if not (0 <= u < window.width and 0 <= v < window.height):
            continue
        pixel = v * window.width + u
        if size[pixel]:
            _look(lists, slots, mask, number, row, begin[pixel], begin[pixel] + size[pixel], apart[n], limit, beta)


@njit(inline="always")
def lists_of(window):
    """The arrays that a step of a list needs: whole windows take long to pass on."""
    return window.t, window.source, window.far, window.degree, window.worst


@njit
def _look(lists, slots, mask, number, row, first, end, base, limit, beta):
    """Offer an event those of a pixel: newer ones outward, then older ones by runs of equal times."""
    t = lists[0]
    at = _first_from(slots, first, end, number)
    for n in range(at, end):
        if slots[n] != number and not offer(lists, mask, row, slots[n], base, limit, beta):
            break
    last = at
    while last > first:
        # the run of those at one time, from its first on
        run = _first_at(t, slots, mask, first, last, t[slots[last - 1] & mask])
        for n in range(run, last):
            if not offer(lists, mask, row, slots[n], base, limit, beta):
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
def _first_at(t, slots, mask, first, last, time):
    """Place of the first event at `time`, which the one before `last` has. Near ones are tried first."""
    step = 1
    low = last - 1
    while low - step >= first and t[slots[low - step] & mask] == time:
        low -= step
        step *= 2
    first = max(first, low - step)
    while first < low:
        middle = (first + low) // 2
        if t[slots[middle] & mask] < time:
            first = middle + 1
        else:
            low = middle
    return first


@njit
def offer(lists, mask, row, other, base, limit, beta):
    """Take an event as a neighbor if it is among the nearest; returns whether it is. `lists`: see `lists_of`."""
    t, source, far, degree, worst = lists
    gap = abs(t[other & mask] - t[row])
    here = base + beta * (np.float64(gap) * np.float64(gap))
    if here > limit:
        return False
    count, last = degree[row], worst[row]
    if count < source.shape[1]:
        source[row, count], far[row, count] = other, here
        degree[row] = count + 1
        if count == 0 or _comes_after(t, source, far, mask, row, count, last):
            worst[row] = count
        return True
    if here > far[row, last]:
        return False
    if here == far[row, last]:
        old = source[row, last]
        apart = abs(t[old & mask] - t[row])
        if gap > apart or (gap == apart and other > old):
            return False
    source[row, last], far[row, last] = other, here
    farthest(lists, mask, row)
    return True


@njit
def farthest(lists, mask, row):
    """Find the farthest neighbor of a row."""
    t, source, far, degree, worst = lists
    last = 0
    for n in range(1, degree[row]):
        if _comes_after(t, source, far, mask, row, n, last):
            last = n
    worst[row] = last


@njit
def _comes_after(t, source, far, mask, row, a, b):
    """Whether a neighbor is farther than another: of equals the one farther in time, then the one that came later."""
    if far[row, a] != far[row, b]:
        return far[row, a] > far[row, b]
    first, second = source[row, a], source[row, b]
    apart, other = abs(t[first & mask] - t[row]), abs(t[second & mask] - t[row])
    return apart > other or (apart == other and first > second)


@njit
def earlier_edges(window, metric, t, x, y):
    """Edges to each event from its near ones among those before it: int64 [2, E], sorted by target; fills the window.

    O(N (pixels up to the farthest neighbor) k).
    """
    n = t.size
    total = 0
    for i in range(n):
        push(window, i, t[i], x[i], y[i])
        search(window, i, metric)
        total += window.degree[i]
    edges, e = np.empty((2, total), np.int64), 0
    for i in range(n):
        sources = np.sort(window.source[i, : window.degree[i]])
        for source in sources:
            edges[0, e], edges[1, e] = source, i
            e += 1
    return edges
