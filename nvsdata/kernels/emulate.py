"""PIX2NVS, one frame at a time (thesis 3.2): tiles that did not change are only compared.

`kernels.tiles` finds these tiles. Arrays: `frame` uint8 [H, W * C]; `plane`, `level`, `reference`,
`difference` of one float type [H, W]; marks of tiles bool [tile rows, tile columns].
Steps that need no neighbors are done band by band, so that a band stays in the cache from bytes to events.
"""

from __future__ import annotations

import math

import numpy as np

from nvsdata.kernels.compiling import njit
from nvsdata.kernels.logarithm import logarithm
from nvsdata.kernels.spikes import fire
from nvsdata.kernels.tiles import AVERAGE, CO_LOCATED, TILE, bounds, look

TABLE_SIZE = 255_001  # luminance in thousandths: 299 r + 587 g + 114 b

_U = np.uint64
_one = np.float32(1)


@njit
def luminance(frame, first_weight, rule, tiles, plane):
    """`plane` = the perceived brightness of pixels of one byte (gray) or three.

    For one byte it is the rule's table[byte]; for three, table[1000 q], q = 0.299 r + 0.587 g + 0.114 b, or (3.1) if
    the table is empty. `first_weight`: weight of the first byte in thousandths, 299 for r, g, b, 114 for b, g, r.
    """
    weight, other = np.int32(first_weight), np.int32(413 - first_weight)
    height, width = plane.shape
    thousandths, scratch = np.empty(width, np.int32), np.empty((2, width), np.uint32)
    for r in range(tiles.shape[0]):
        right = 0
        while right < tiles.shape[1]:
            # neighboring tiles together
            left = right
            while right < tiles.shape[1] and tiles[r, right] == tiles[r, left]:
                right += 1
            if not tiles[r, left]:
                continue
            x0, x1 = left * TILE[1], min(right * TILE[1], width)
            q = thousandths[: x1 - x0]
            for y in range(r * TILE[0], min((r + 1) * TILE[0], height)):
                if frame.shape[1] == width:
                    look_up(frame[y, x0:x1], rule.table, plane[y, x0:x1])
                    continue
                weigh(frame[y, 3 * x0 : 3 * x1], weight, other, q)
                if rule.table.size:
                    look_up(q, rule.table, plane[y, x0:x1])
                else:
                    logarithm(q, rule.t_log, rule.slope, scratch, plane[y, x0:x1])


@njit
def weigh(row, weight, other, thousandths):
    """Luminance of pixels in a row, in thousandths. Faster by half if the weights are int32."""
    for i in range(_U(thousandths.size)):
        c = _U(3) * i
        a, g, b = np.int32(row[c]), np.int32(row[c + _U(1)]), np.int32(row[c + _U(2)])
        thousandths[i] = weight * a + np.int32(587) * g + other * b


@njit
def look_up(places, table, out):
    """`out` = the table's values at `places`."""
    for i in range(_U(out.size)):
        out[i] = table[_U(np.uint32(places[i]))]


@njit
def contrast(plane, tiles, then_log, t_log, slope, level):
    """Mean distance from the four neighbors, (3.2), borders replicated; then (3.1) if `then_log`."""
    height, width = plane.shape
    for tile in np.ndindex(tiles.shape):
        if not tiles[tile]:
            continue
        y0, y1, x0, x1 = bounds(tile, plane.shape)
        for y in range(y0, y1):
            up, down = max(y - 1, 0), min(y + 1, height - 1)
            for x in range(x0, x1):
                here = np.float64(plane[y, x])
                sides = abs(here - plane[y, max(x - 1, 0)]) + abs(here - plane[y, min(x + 1, width - 1)])
                value = (sides + abs(here - plane[up, x]) + abs(here - plane[down, x])) / 4
                if then_log:
                    value = math.log(value) if value > t_log else value * slope
                level[y, x] = value


@njit
def differ(level, reference, method, sensitivity, tiles, difference):
    """`difference` of level and reference by (3.3) or (3.4), borders replicated; times `sensitivity` if not empty."""
    height = level.shape[0]
    for tile in np.ndindex(tiles.shape):
        if not tiles[tile]:
            continue
        y0, y1, x0, x1 = bounds(tile, level.shape)
        for y in range(y0, y1):
            above, below = reference[max(y - 1, 0)], reference[min(y + 1, height - 1)]
            if method == CO_LOCATED:
                for x in range(_U(x0), _U(x1)):
                    difference[y, x] = level[y, x] - reference[y, x]
            else:
                _differ_from_neighbors(level[y], above, reference[y], below, method, x0, x1, difference[y])
            if sensitivity.size:
                for x in range(_U(x0), _U(x1)):
                    difference[y, x] *= sensitivity[y, x]


@njit
def _differ_from_neighbors(level, above, here, below, method, x0, x1, difference):
    """`differ` in a row from `x0` to `x1`; only the pixels at its ends have a neighbor in common with themselves."""
    last = level.size - 1
    begin, end = max(x0, 1), min(x1, last)
    if method == AVERAGE:
        for x in range(_U(begin), _U(end)):
            difference[x] = level[x] - _average(above, here, below, x - _U(1), x, x + _U(1))
    else:
        for x in range(_U(begin), _U(end)):
            difference[x] = level[x] - _least(above, below, x - _U(1), x + _U(1))
    for x in (0, last):
        if x0 <= x < x1:
            left, right = max(x - 1, 0), min(x + 1, last)
            is_average = method == AVERAGE
            other = _average(above, here, below, left, x, right) if is_average else _least(above, below, left, right)
            difference[x] = level[x] - other


@njit
def _average(above, here, below, left, x, right):
    return (np.float64(here[left]) + here[right] + above[x] + below[x]) / 4


@njit
def _least(above, below, left, right):
    return np.float64(min(above[left], below[right]))


@njit
def inhibit(difference, side, active):
    """Keep the largest |d| (the first of equals) of each `side` x `side` block, (3.5). Blocks count from the corner."""
    height, width = difference.shape
    if side == 2:
        _inhibit_pairs(difference, active)
        return
    if TILE[0] % side:
        _clear(difference, side, active)
    for top in range(0, height, side):
        bottom = min(top + side, height)
        for left in range(0, width, side):
            right = min(left + side, width)
            if not _touches(active, top, bottom, left, right):
                continue
            best, by, bx = -_one, top, left
            for y in range(top, bottom):
                for x in range(left, right):
                    if abs(difference[y, x]) > best:
                        best, by, bx = abs(difference[y, x]), y, x
            for y in range(top, bottom):
                for x in range(left, right):
                    if y != by or x != bx:
                        difference[y, x] = 0


@njit
def _clear(difference, side, active):
    """Zero what lies in blocks across tiles on the side of still ones: no |d| there reaches the threshold."""
    height, width = difference.shape
    for tile in np.ndindex(active.shape):
        if active[tile]:
            continue
        y0, y1, x0, x1 = bounds(tile, difference.shape)
        bottom, right = min(-(-y1 // side) * side, height), min(-(-x1 // side) * side, width)
        if _touches(active, y0 // side * side, bottom, x0 // side * side, right):
            difference[y0:y1, x0:x1] = 0


@njit
def _inhibit_pairs(difference, active):
    """`inhibit` for blocks of 2 x 2, without branches; none lies across tiles."""
    zero = difference.dtype.type(0)
    for tile in np.ndindex(active.shape):
        if not active[tile]:
            continue
        y0, y1, x0, x1 = bounds(tile, difference.shape)
        for y in range(y0, y1, 2):
            upper = difference[y, x0:x1]
            # a block that sticks out has fewer pixels
            lower = difference[y + 1, x0:x1] if y + 1 < y1 else np.zeros_like(upper)
            pairs = upper.size // 2
            for i in range(_U(pairs)):
                j = _U(2) * i
                a, b, c, d = upper[j], upper[j + _U(1)], lower[j], lower[j + _U(1)]
                m, n, o, p = abs(a), abs(b), abs(c), abs(d)
                first, second = m >= max(n, o, p), n >= max(m, o, p)
                third = o >= max(m, n, p)
                upper[j] = a if first else zero
                upper[j + _U(1)] = b if second and not first else zero
                lower[j] = c if third and not (first or second) else zero
                lower[j + _U(1)] = zero if first or second or third else d
            if upper.size > 2 * pairs:
                j = upper.size - 1
                if abs(upper[j]) >= abs(lower[j]):
                    lower[j] = zero
                else:
                    upper[j] = zero


@njit
def _touches(active, top, bottom, left, right):
    found = False
    for r in range(top // TILE[0], (bottom - 1) // TILE[0] + 1):
        for c in range(left // TILE[1], (right - 1) // TILE[1] + 1):
            found |= active[r, c]
    return found


@njit
def update(level, reference, difference, rule, active, still):
    """New references of active tiles, (3.9) and (3.10); then which tiles are still.

    With alpha >= 1 the reference becomes the level. Without `everywhere`, only where |difference| >= threshold. A tile
    is still if it would not fire as long as it doesn't change. Co-located differences then only shrink, so none may
    reach `calm`; others depend on neighbors, so no value may have moved, and none may have fired.
    """
    threshold, alpha, everywhere, calm = rule.threshold, rule.alpha, rule.everywhere, rule.calm
    for tile in np.ndindex(active.shape):
        if not active[tile]:
            continue
        y0, y1, x0, x1 = bounds(tile, level.shape)
        restless = False
        for y in range(y0, y1):
            for x in range(_U(x0), _U(x1)):
                here, before = level[y, x], reference[y, x]
                fired = abs(difference[y, x]) >= threshold
                follows = everywhere | fired
                after = here if alpha >= _one else before + alpha * (here - before)
                after = after if follows else before
                reference[y, x] = after
                if rule.method == CO_LOCATED:
                    restless |= abs(here - after) >= calm
                else:
                    restless |= fired | (after != before)
        still[tile] = not restless


@njit
def step(frame, previous, first_weight, rule, tiles, pixels, span, seed, keys):
    """Process a frame, band by band; returns the keys of its events and their number, see `fire`.

    An empty `frame` means that `look` was called, and that `plane` and `level` are up to date. The rest is a single
    call, because each call releases Python's lock to other threads, and waits until it has it again.
    """
    n = np.int64(0)
    if frame.size and not look(frame, previous, rule, tiles, pixels):
        return keys, n
    height, rows = pixels.level.shape[0], pixels.difference.shape[0]
    for top in range(0, height, rows):
        end = min(top + rows, height)
        first, last = top // TILE[0], (end + TILE[0] - 1) // TILE[0]
        active = tiles.active[first:last]
        if not active.any():
            continue
        level, reference, difference = pixels.level[top:end], pixels.reference[top:end], pixels.difference[: end - top]
        if frame.size:
            dirty, plane = tiles.dirty[first:last], pixels.plane[top:end]
            luminance(frame[top:end], first_weight, rule, dirty, plane)
        differ(level, reference, rule.method, rule.sensitivity[top:end], active, difference)
        if rule.side > 1:
            inhibit(difference, rule.side, active)
        keys, n = fire(difference, top, active, rule.threshold, rule.most, span, rule.timing, seed, keys, n)
        update(level, reference, difference, rule, active, tiles.still[first:last])
    return keys, n
