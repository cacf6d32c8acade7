"""Events grouped by pixel, and the pixels that have events near one."""

from __future__ import annotations

import numpy as np

from nvsdata.kernels.bits import ascending, bit_sets, mark, trailing_zeros
from nvsdata.kernels.compiling import njit

FAR = np.int64(1) << 40  # squared pixels: beyond every sensor
TABLE = 8  # pixels up to which the offsets to look at are listed, nearest first
SIDE, _SHIFT, _LOW = 8, 3, 7  # of a tile of pixels
FLAT = 8  # places per event up to which one array for all is made
PAD = 8  # pixels around the events, at least TABLE, so that no look-up leaves the tiles


@njit
def by_pixel(x, y):
    """Events grouped by pixel, and pixels by tile, row by row. O(N + tiles of the box around all events).

    Returns the events' indices int32 [N], pixel by pixel and in order within each; where each pixel's begin int32
    [P + 1]; the pixels' places int32 [P, 2] within the padded box; and `tiles` int32 [rows, columns], of 8 x 8
    pixels, which say what row of `blocks` int32 [occupied tiles + 1, 64] has the pixel's number, or -1 where there are
    no events. Row 0 is that of all empty tiles.
    """
    n = x.size
    x0 = x1 = np.int64(x[0]) if n else np.int64(0)
    y0 = y1 = np.int64(y[0]) if n else np.int64(0)
    for i in range(np.uint64(n)):
        x0, x1, y0, y1 = min(x0, x[i]), max(x1, x[i]), min(y0, y[i]), max(y1, y[i])
    # unsigned, because numba tests every signed index for negative ones
    one, low, shift = np.uint64(1), np.uint64(_LOW), np.uint64(_SHIFT)
    left, top = x0 - PAD, y0 - PAD
    tiles = np.zeros(((y1 - top + PAD) // SIDE + 1, (x1 - left + PAD) // SIDE + 1), np.int32)
    columns, marked, used = np.uint64(tiles.shape[1]), *bit_sets(1, tiles.size)
    for i in range(np.uint64(n)):
        mark((np.uint64(y[i] - top) >> shift) * columns + (np.uint64(x[i] - left) >> shift), marked[0], used)
    occupied = ascending(marked[0], used, np.empty(min(n, tiles.size), np.int64))
    for q in range(np.uint64(occupied.size)):
        tiles.ravel()[occupied[q]] = q + one
    cells = np.zeros(occupied.size + 1, np.uint64)
    for i in range(np.uint64(n)):
        row, column = np.uint64(y[i] - top), np.uint64(x[i] - left)
        tile = np.uint64(tiles[row >> shift, column >> shift])
        cells[tile] |= one << (((row & low) << shift) + (column & low))
    place, blocks = _pixels_of(occupied, columns, cells, n)
    pixel, count = np.empty(n, np.int32), np.zeros(len(place) + 1, np.int32)
    for i in range(np.uint64(n)):
        row, column = np.uint64(y[i] - top), np.uint64(x[i] - left)
        tile = np.uint64(tiles[row >> shift, column >> shift])
        pixel[i] = blocks[tile, ((row & low) << shift) + (column & low)]
        count[np.uint64(pixel[i]) + one] += 1
    for q in range(np.uint64(len(place))):
        count[q + one] += count[q]
    first, order = count.copy(), np.empty(n, np.int32)
    for i in range(np.uint64(n)):
        q = np.uint64(pixel[i])
        order[np.uint64(count[q])] = i
        count[q] += 1
    return order, first, place, tiles, blocks


@njit
def _pixels_of(tiles, columns, cells, events):
    """Places of the pixels of some tiles, for each of which `cells` has a bit, and their numbers in blocks."""
    one, low, shift = np.uint64(1), np.uint64(_LOW), np.uint64(_SHIFT)
    place, blocks = np.empty((events, 2), np.int32), np.full((cells.size, SIDE * SIDE), -1, np.int32)
    pixels = np.uint64(0)
    for q in range(np.uint64(tiles.size)):
        row = np.uint64(tiles[q]) // columns
        column = np.uint64(tiles[q]) - row * columns
        bits = cells[q + one]
        while bits:
            cell = trailing_zeros(bits)
            bits &= bits - one
            place[pixels, 0], place[pixels, 1] = column << shift | cell & low, row << shift | cell >> shift
            blocks[q + one, cell] = pixels
            pixels += one
    return place[:pixels], blocks


@njit
def offsets_within(furthest):
    """Offsets (dx, dy) of squared length up to `furthest`, nearest first: int32 [M, 2].

    Also where those of equal length begin, int64 [rings + 1], and their squared lengths, int64 [rings].
    """
    reach = 0
    while (reach + 1) ** 2 <= furthest:
        reach += 1
    count = np.zeros(furthest + 2, np.int64)
    for dy in range(-reach, reach + 1):
        for dx in range(-reach, reach + 1):
            if dx * dx + dy * dy <= furthest:
                count[dx * dx + dy * dy + 1] += 1
    rings = 0
    begins, lengths = np.zeros(furthest + 2, np.int64), np.empty(furthest + 1, np.int64)
    for d in range(furthest + 1):
        if count[d + 1]:
            begins[rings], lengths[rings] = count[d], d
            rings += 1
        count[d + 1] += count[d]
    begins[rings] = count[furthest + 1]
    offsets = np.empty((begins[rings], 2), np.int32)
    for dy in range(-reach, reach + 1):
        for dx in range(-reach, reach + 1):
            d = dx * dx + dy * dy
            if d <= furthest:
                offsets[count[d], 0], offsets[count[d], 1] = dx, dy
                count[d] += 1
    return offsets, begins[: rings + 1], lengths[:rings]


@njit
def flat_map(events, place, tiles, offsets):
    """Numbers of pixels by place, row by row in one array, -1 where there are none, and `offsets` in it as steps.

    The array is empty if it were large for the number of events.
    """
    columns = tiles.shape[1] * SIDE
    places = tiles.shape[0] * SIDE * columns
    flat = np.full(places if places <= FLAT * (events + 512) else 0, -1, np.int32)
    steps = np.empty(len(offsets), np.uint64)
    for o in range(len(offsets)):
        steps[o] = offsets[o, 1] * columns + offsets[o, 0]
    if flat.size:
        for q in range(len(place)):
            flat[place[q, 1] * columns + place[q, 0]] = q
    return flat, steps


@njit
def near_pixels(
    pixel, enough, furthest, blur, first, place, tiles, blocks, flat, offsets, steps, begins, lengths, near, apart
):
    """Pixels that have events near one, itself included, nearest first: their number m, and that of their events.

    `near` and `apart` get the pixels and their squared distances. None is further than `furthest`. As soon as pixels
    of a distance or less have `enough` events together, others are left out unless they are nearer than that
    plus `blur`. `offsets` are those of `offsets_within`, `flat` and `steps` of `flat_map`.
    """
    x, y = np.int64(place[pixel, 0]), np.int64(place[pixel, 1])
    # unsigned, because numba tests every signed index for negative ones
    low, shift = np.uint64(_LOW), np.uint64(_SHIFT)
    here = np.uint64(y * tiles.shape[1] * SIDE + x)
    m, total, bound = np.uint64(0), np.int64(0), furthest
    for ring in range(np.uint64(lengths.size)):
        length = lengths[ring]
        if length > bound:
            return np.int64(m), total
        before, start, stop = m, np.uint64(begins[ring]), np.uint64(begins[ring + np.uint64(1)])
        # without branches within, because which pixels have events is unpredictable
        if flat.size:
            for o in range(start, stop):
                found = flat[here + steps[o]]
                near[m], apart[m] = found, length
                m += np.uint64(found >= 0)
        else:
            for o in range(start, stop):
                column, row = np.uint64(x + offsets[o, 0]), np.uint64(y + offsets[o, 1])
                tile = np.uint64(tiles[row >> shift, column >> shift])
                found = blocks[tile, ((row & low) << shift) + (column & low)]
                near[m], apart[m] = found, length
                m += np.uint64(found >= 0)
        for q in range(before, m):
            one = np.uint64(near[q])
            total += first[one + np.uint64(1)] - first[one]
        if total >= enough:
            bound = min(bound, length + blur)
    m = np.int64(m)
    if bound > lengths[-1]:
        m, total = _beyond(x, y, m, total, enough, bound, blur, first, place, tiles, blocks, lengths[-1], near, apart)
    return m, total


@njit
def _beyond(x, y, m, total, enough, bound, blur, first, place, tiles, blocks, listed, near, apart):
    """Go on with the pixels further than `listed`, in squares of tiles around the one at x, y."""
    rows, columns = tiles.shape
    here, there = y >> _SHIFT, x >> _SHIFT
    final = m
    for ring in range(max(rows, columns)):
        nearest = ((ring - 1) * SIDE + 1) ** 2 if ring else 0
        if nearest > bound:
            break
        # nothing that comes is nearer than these
        while final < m and apart[final] <= nearest:
            final += 1
        before = m
        for row in range(max(here - ring, 0), min(here + ring + 1, rows)):
            # all tiles of the first and last row of a square, and two of the others
            step = 1 if abs(row - here) == ring else 2 * ring
            for column in range(there - ring, there + ring + 1, step):
                if not 0 <= column < columns or tiles[row, column] == 0:
                    continue
                for q in blocks[tiles[row, column]]:
                    if q < 0:
                        continue
                    d = (np.int64(place[q, 0]) - x) ** 2 + (np.int64(place[q, 1]) - y) ** 2
                    if listed < d <= bound:
                        near[m], apart[m] = q, d
                        m += 1
                        total += first[q + 1] - first[q]
        if m == before:
            continue
        _sort(near, apart, final, before, m)
        if total >= enough:
            bound = min(bound, _distance_of(enough, first, near, apart) + blur)
            while apart[m - 1] > bound:
                m -= 1
                total -= first[near[m] + 1] - first[near[m]]
    return m, total


@njit
def _sort(near, apart, start, ordered, m):
    """Sort the pixels from `start` up to `m` by distance, of which those before `ordered` are in order."""
    if m - ordered <= 8:
        for k in range(ordered, m):
            q, d, slot = near[k], apart[k], k
            while slot > start and apart[slot - 1] > d:
                apart[slot], near[slot] = apart[slot - 1], near[slot - 1]
                slot -= 1
            apart[slot], near[slot] = d, q
        return
    order = np.argsort(apart[start:m], kind="mergesort")
    pixels, distances = near[start:m].copy(), apart[start:m].copy()
    for k in range(m - start):
        near[start + k], apart[start + k] = pixels[order[k]], distances[order[k]]


@njit
def _distance_of(enough, first, near, apart):
    """Squared distance up to which pixels have `enough` events together."""
    have = q = 0
    while True:
        have += first[near[q] + 1] - first[near[q]]
        if have >= enough:
            return apart[q]
        q += 1
