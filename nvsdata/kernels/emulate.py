"""PIX2NVS a frame at a time (thesis 3.2): tiles that did not change are compared and left.

A frame is cut into tiles of `TILE` pixels. A tile is dirty if a byte of it changed, active if its
pixels have to be looked at, still if they need not be until it or a neighbour gets dirty.
Arrays: `frame`, `previous` uint8 [H, W * C]; `plane`, `level`, `reference`, `difference` of one
float type [H, W]; `dirty`, `active`, `still` bool and `behind` int64 [tile rows, tile columns].
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

TILE = (8, 64)  # rows, columns: 64 pixels of 3 bytes are three cache lines
TABLE_SIZE = 255_001  # luminance in thousandths: 299 r + 587 g + 114 b
CO_LOCATED, AVERAGE, MINIMUM = range(3)
INTERPOLATED, RANDOM, AT_ONCE = range(3)

_U = np.uint64
_one = np.float32(1)


@njit(cache=True, nogil=True)
def _bounds(tile, shape):
    """First and last row and column of a tile."""
    y, x = tile[0] * TILE[0], tile[1] * TILE[1]
    return y, min(y + TILE[0], shape[0]), x, min(x + TILE[1], shape[1])


@njit(cache=True, nogil=True)
def find_dirty(frame, previous, tile_items, dirty):
    """Mark the tiles that differ from the `previous` frame's; return how many. O(bytes).

    Frames are [H, items] of bytes or, three times as fast, words of 8 of them; `tile_items` make a tile's row.
    """
    height, row_items = frame.shape
    count = 0
    for r, c in np.ndindex(dirty.shape):
        lo, hi = _U(c * tile_items), _U(min((c + 1) * tile_items, row_items))
        dirty[r, c] = False
        for y in range(r * TILE[0], min((r + 1) * TILE[0], height)):
            differs = frame[0, 0] ^ frame[0, 0]
            for i in range(lo, hi):
                differs |= frame[y, i] ^ previous[y, i]
            if differs:
                dirty[r, c] = True
                break
        count += dirty[r, c]
    return count


@njit(cache=True, nogil=True)
def spread(marks, out):
    """Whether a tile or any of its eight neighbours is marked."""
    rows, columns = marks.shape
    for r, c in np.ndindex(marks.shape):
        found = False
        for i in range(max(r - 1, 0), min(r + 2, rows)):
            for j in range(max(c - 1, 0), min(c + 2, columns)):
                found |= marks[i, j]
        out[r, c] = found


@njit(cache=True, nogil=True)
def catch_up(reference, level, alpha, behind, tiles):
    """Moving averages that were left behind, (3.10): the very steps left out, until none moves a value."""
    for tile in np.ndindex(tiles.shape):
        if not tiles[tile] or behind[tile] == 0:
            continue
        y0, y1, x0, x1 = _bounds(tile, level.shape)
        for _ in range(behind[tile]):
            moved = 0
            for y in range(y0, y1):
                for x in range(_U(x0), _U(x1)):
                    before = reference[y, x]
                    after = before + alpha * (level[y, x] - before)
                    reference[y, x] = after
                    moved += after != before
            if moved == 0:
                break
        behind[tile] = 0


@njit(cache=True, nogil=True)
def luminance(frame, channels, first_weight, table, tiles, plane):
    """`plane` = table[1000 q], q = 0.299 r + 0.587 g + 0.114 b of three bytes or one, grey; exactly.

    `first_weight`, in thousandths, is that of a pixel's first byte: 299 for r, g, b, 114 for b, g, r.
    """
    weight, other = np.int32(first_weight), np.int32(413 - first_weight)
    scratch = np.empty(TILE[1], np.int32)
    for tile in np.ndindex(tiles.shape):
        if not tiles[tile]:
            continue
        y0, y1, x0, x1 = _bounds(tile, plane.shape)
        first, width = _U(x0), _U(x1 - x0)
        for y in range(y0, y1):
            # two loops: the first is vectorised
            if channels == 3:
                for i in range(width):
                    c = _U(3) * (first + i)
                    a, g, b = np.int32(frame[y, c]), np.int32(frame[y, c + _U(1)]), np.int32(frame[y, c + _U(2)])
                    scratch[i] = weight * a + np.int32(587) * g + other * b
            else:
                for i in range(width):
                    scratch[i] = np.int32(1000) * np.int32(frame[y, first + i])
            for i in range(width):
                plane[y, first + i] = table[_U(np.uint32(scratch[i]))]


@njit(cache=True, nogil=True)
def contrast(plane, tiles, then_log, t_log, slope, level):
    """Mean distance from the four neighbours, (3.2), borders replicated; then (3.1) if `then_log`."""
    height, width = plane.shape
    for tile in np.ndindex(tiles.shape):
        if not tiles[tile]:
            continue
        y0, y1, x0, x1 = _bounds(tile, plane.shape)
        for y in range(y0, y1):
            up, down = max(y - 1, 0), min(y + 1, height - 1)
            for x in range(x0, x1):
                here = np.float64(plane[y, x])
                sides = abs(here - plane[y, max(x - 1, 0)]) + abs(here - plane[y, min(x + 1, width - 1)])
                value = (sides + abs(here - plane[up, x]) + abs(here - plane[down, x])) / 4
                if then_log:
                    value = math.log(value) if value > t_log else value * slope
                level[y, x] = value


@njit(cache=True, nogil=True)
def differ(level, reference, method, sensitivity, tiles, difference):
    """`difference` of level and reference by (3.3) or (3.4), borders replicated; times `sensitivity` if not empty."""
    height, width = level.shape
    for tile in np.ndindex(tiles.shape):
        if not tiles[tile]:
            continue
        y0, y1, x0, x1 = _bounds(tile, level.shape)
        for y in range(y0, y1):
            up, down = max(y - 1, 0), min(y + 1, height - 1)
            if method == CO_LOCATED:
                for x in range(_U(x0), _U(x1)):
                    difference[y, x] = level[y, x] - reference[y, x]
            else:
                for x in range(x0, x1):
                    left, right = max(x - 1, 0), min(x + 1, width - 1)
                    if method == AVERAGE:
                        row = np.float64(reference[y, left]) + reference[y, right]
                        other = (row + reference[up, x] + reference[down, x]) / 4
                    else:
                        other = np.float64(min(reference[up, left], reference[down, right]))
                    difference[y, x] = level[y, x] - other
            if sensitivity.size:
                for x in range(_U(x0), _U(x1)):
                    difference[y, x] *= sensitivity[y, x]


@njit(cache=True, nogil=True)
def inhibit(difference, side, active):
    """Of each `side` x `side` block keep the largest |d| (the first of equals), (3.5). Blocks count from the corner."""
    height, width = difference.shape
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


@njit(cache=True, nogil=True)
def _touches(active, top, bottom, left, right):
    found = False
    for r in range(top // TILE[0], (bottom - 1) // TILE[0] + 1):
        for c in range(left // TILE[1], (right - 1) // TILE[1] + 1):
            found |= active[r, c]
    return found


@njit(cache=True, nogil=True)
def update(level, reference, difference, threshold, alpha, everywhere, method, calm, active, still, behind):
    """New references of active tiles, (3.9) and (3.10); then which tiles are still.

    alpha >= 1 takes the level itself. Without `everywhere` only where |difference| >= threshold. A tile
    is still if, unchanged, it would not fire: co-located differences then only shrink, so none may
    reach `calm`; others depend on neighbours, so no value may have moved, nor any fired.
    """
    for tile in np.ndindex(active.shape):
        if not active[tile]:
            # only where all positions follow does a still tile fall behind
            behind[tile] += everywhere and alpha < _one
            continue
        y0, y1, x0, x1 = _bounds(tile, level.shape)
        restless = 0
        for y in range(y0, y1):
            for x in range(_U(x0), _U(x1)):
                here, before = level[y, x], reference[y, x]
                fired = abs(difference[y, x]) >= threshold
                follows = everywhere | fired
                after = here if alpha >= _one else before + alpha * (here - before)
                after = after if follows else before
                reference[y, x] = after
                if method == CO_LOCATED:
                    restless += abs(here - after) >= calm
                else:
                    restless += fired | (after != before)
        still[tile] = restless == 0


@njit(cache=True, nogil=True)
def fire(difference, active, threshold, most, span, timing, seed, keys, n, row):
    """Events where |difference| >= threshold, (3.6) and (3.8), in raster order, from row `row` on.

    An event is a key of 64 bits: µs since the last frame << 32 | y << 17 | x << 1 | ON. Times are
    k span T / |d| for the k-th of a position (`INTERPOLATED`), random, or left at 0; the one value of `span`
    is the µs between the frames. `n` keys are there already. Returns the number of keys and the row to
    go on with once `keys` has more room, or the height. O(active pixels + events).
    """
    height, width = difference.shape
    mask = np.zeros(TILE[1], np.uint8)
    words = mask.view(np.uint64)
    x, count = np.empty(width + 8, np.uint16), np.empty(width + 8, np.int64)
    ratio, step = np.empty(width + 8, difference.dtype), np.empty(width + 8, span.dtype)
    half, none = span.dtype.type(0.5), False
    for y in range(row, height):
        tiles = active[y // TILE[0]]
        if y % TILE[0] == 0:
            none = not tiles.any()
        if none:
            continue
        m = 0
        for c in range(tiles.size):
            if not tiles[c]:
                continue
            x0, x1 = c * TILE[1], min((c + 1) * TILE[1], width)
            first = _U(x0)
            mask[x1 - x0 :] = 0
            for i in range(_U(x1 - x0)):
                mask[i] = abs(difference[y, first + i]) >= threshold
            for w in range(_U(words.size)):
                word = words[w]
                if word:
                    # without branches: which of the eight fire can't be foretold
                    for i in range(_U(8)):
                        x[m] = first + _U(8) * w + i
                        m += np.int64((word >> (_U(8) * i)) & _U(1))
        # a loop for each array, so that each is vectorised
        for j in range(_U(m)):
            ratio[j] = difference[y, _U(x[j])]
        for j in range(_U(m)):
            ratio[j] = ratio[j] / threshold
        for j in range(_U(m)):
            step[j] = span[0] / abs(ratio[j])
        total = 3
        for j in range(_U(m)):
            count[j] = min(np.int64(abs(ratio[j])), most)
            total += count[j]
        if n + total > keys.size:
            return n, y
        row_key = _U(y) << _U(17)
        if timing == INTERPOLATED and most <= 3:
            for j in range(_U(m)):
                key = row_key | _U(x[j]) << _U(1) | _U(ratio[j] > 0)
                # all three are written, the next position overwrites those that don't count
                time = step[j] + half
                keys[n] = _U(np.uint32(np.int32(time))) << _U(32) | key
                time += step[j]
                keys[n + 1] = _U(np.uint32(np.int32(time))) << _U(32) | key
                time += step[j]
                keys[n + 2] = _U(np.uint32(np.int32(time))) << _U(32) | key
                n += count[j]
            continue
        for j in range(_U(m)):
            key = row_key | _U(x[j]) << _U(1) | _U(ratio[j] > 0)
            for k in range(count[j]):
                time = _U(0)
                if timing == INTERPOLATED:
                    time = _U(np.int64((k + 1) * step[j] + half))
                elif timing == RANDOM:
                    time = _random(seed, (key << _U(16)) + _U(k)) % _U(span[0])
                keys[n] = time << _U(32) | key
                n += 1
    return n, height


@njit(cache=True, nogil=True)
def _random(seed, place):
    """64 random bits that depend on both numbers only (splitmix64, Steele et al. 2014)."""
    z = seed + (place + _U(1)) * _U(0x9E3779B97F4A7C15)
    z = (z ^ (z >> _U(30))) * _U(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> _U(27))) * _U(0x94D049BB133111EB)
    return z ^ (z >> _U(31))


@njit(cache=True, nogil=True)
def sort_keys(keys, spare, bits):
    """Sort keys stably by their times below 2^bits: radix sort, digits of at most 11 bits; `spare` is scratch.

    Returns whichever of the two arrays holds the result. O(N bits / 11).
    """
    passes = max((bits + 10) // 11, 1 if bits <= 8 else 2)
    digit = (bits + passes - 1) // passes
    for turn in range(passes):
        shift, mask = _U(32 + turn * digit), _U((1 << digit) - 1)
        ends = np.zeros(1 << digit, np.int64)
        for i in range(_U(keys.size)):
            ends[(keys[i] >> shift) & mask] += 1
        total = 0
        for d in range(ends.size):
            total, ends[d] = total + ends[d], total
        for i in range(_U(keys.size)):
            d = (keys[i] >> shift) & mask
            spare[_U(ends[d])] = keys[i]
            ends[d] += 1
        keys, spare = spare, keys
    return keys


@njit(cache=True, nogil=True)
def unpack(keys, start, t, x, y, p):
    """Columns of events from their keys; times count from `start`."""
    for i in range(_U(keys.size)):
        key = keys[i]
        t[i] = start + np.int64(key >> _U(32))
        x[i] = np.int16((key >> _U(1)) & _U(0xFFFF))
        y[i] = np.int16((key >> _U(17)) & _U(0x7FFF))
        p[i] = np.uint8(key & _U(1))


@njit(cache=True, nogil=True)
def read_out(t, x, y, width, ready, refractory, gap, busy, start):
    """Times at which events leave a sensor that passes one every `gap` µs, and which of them do. O(N).

    The readout is taken until `start` + `busy`; the new value is returned. A pixel is blind while its
    event waits and for `refractory` µs after: `ready` int64 [H * W] has the µs at which it sees again.
    """
    out, kept = np.empty_like(t), np.zeros(t.size, np.bool_)
    for i in range(t.size):
        pixel = y[i] * np.int64(width) + x[i]
        if t[i] < ready[pixel]:
            continue
        free = max(float(t[i] - start), busy)
        busy = free + gap
        out[i] = start + np.int64(math.ceil(free))
        kept[i] = True
        ready[pixel] = max(out[i], t[i]) + refractory
    return out, kept, busy
