"""Which tiles of a frame PIX2NVS has to look at: those that changed, and what they and earlier frames make restless.

A frame is cut into tiles of `TILE` pixels. Frames are uint8 [H, bytes of a row].
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

TILE = (8, 64)  # rows, columns: 64 pixels of 3 bytes are three cache lines
CO_LOCATED, AVERAGE, MINIMUM = range(3)

_U = np.uint64


class Rule(NamedTuple):
    """What stays the same from frame to frame, see `luminance`, `differ`, `inhibit`, `fire` and `update`.

    `contrast` says that brightness is seen beside that of neighbors.
    """

    contrast: bool
    table: np.ndarray
    t_log: np.floating
    slope: np.floating
    method: int
    sensitivity: np.ndarray
    side: int
    threshold: np.floating
    most: int
    timing: int
    alpha: np.floating
    everywhere: bool
    calm: np.floating


class Tiles(NamedTuple):
    """The state of tiles, [tile rows, tile columns]: bool, and how many frames references are `behind`, int64.

    `dirty` are those that changed, `affected` those in which brightness is seen otherwise than before (the same
    array where neighbors don't matter), `active` those that have to be looked at; `still` ones need not be until
    they or their neighbors get dirty.
    """

    dirty: np.ndarray
    affected: np.ndarray
    active: np.ndarray
    still: np.ndarray
    behind: np.ndarray


class Pixels(NamedTuple):
    """The state of pixels; `difference` has as many rows as a band."""

    plane: np.ndarray
    level: np.ndarray
    reference: np.ndarray
    difference: np.ndarray


@njit(cache=True, nogil=True)
def bounds(tile, shape):
    """First and last row and column of a tile."""
    y, x = tile[0] * TILE[0], tile[1] * TILE[1]
    return y, min(y + TILE[0], shape[0]), x, min(x + TILE[1], shape[1])


@njit(cache=True, nogil=True)
def look(frame, previous, rule, tiles, pixels):
    """Find what a frame changes and makes active, and bring references there up to date; whether there is any."""
    width = pixels.level.shape[1]
    changed = find_dirty(frame, previous, frame.shape[1] // width * TILE[1], tiles.dirty)
    follows = rule.everywhere and rule.alpha < 1  # does a reference move where nobody looks?
    if changed or not tiles.still.all():
        _wake(rule, tiles)
        catch_up(pixels.reference, pixels.level, rule.alpha, tiles.behind, tiles.active)
    else:
        tiles.active[:] = False
    found = False
    for tile in np.ndindex(tiles.active.shape):
        found |= tiles.active[tile]
        tiles.behind[tile] += follows and not tiles.active[tile]
    return found


@njit(cache=True, nogil=True)
def find_dirty(frame, previous, tile_bytes, dirty):
    """Mark the tiles that differ from the `previous` frame's; return how many. O(bytes)."""
    count = 0
    for r in range(dirty.shape[0]):
        marks = dirty[r]
        marks[:] = False
        marked = 0
        for y in range(r * TILE[0], min((r + 1) * TILE[0], frame.shape[0])):
            # a row at one go while all are clean: memory is read fastest in its order
            if marked == marks.size or (marked == 0 and not _changed(frame[y], previous[y])):
                continue
            for c in range(marks.size):
                lo, hi = c * tile_bytes, min((c + 1) * tile_bytes, frame.shape[1])
                if not marks[c] and _changed(frame[y, lo:hi], previous[y, lo:hi]):
                    marks[c] = True
                    marked += 1
        count += marked
    return count


@njit(cache=True, nogil=True)
def _changed(row, previous):
    found = False
    for i in range(_U(row.size)):
        found |= row[i] != previous[i]
    return found


@njit(cache=True, nogil=True)
def _wake(rule, tiles):
    """Which tiles are affected and active: changed ones, restless ones, and neighbors that matter."""
    affected, active = tiles.affected, tiles.active
    if rule.contrast:
        spread(tiles.dirty, affected)
    for tile in np.ndindex(active.shape):
        active[tile] = affected[tile] or not tiles.still[tile]
    if rule.method != CO_LOCATED:
        spread(active.copy(), active)
    if TILE[0] % rule.side:
        # blocks lie across tiles
        active[:] = True


@njit(cache=True, nogil=True)
def spread(marks, out):
    """Whether a tile or any of its eight neighbors is marked."""
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
        y0, y1, x0, x1 = bounds(tile, level.shape)
        for _ in range(behind[tile]):
            moved = False
            for y in range(y0, y1):
                for x in range(_U(x0), _U(x1)):
                    before = reference[y, x]
                    after = before + alpha * (level[y, x] - before)
                    reference[y, x] = after
                    moved |= after != before
            if not moved:
                break
        behind[tile] = 0
