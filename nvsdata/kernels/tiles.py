"""The tiles of a frame that PIX2NVS has to process: those that changed, and those that they or earlier frames affect.

A frame is cut into tiles of `TILE` pixels. Frames are uint8 [H, bytes of a row].
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from nvsdata.kernels.compiling import njit

TILE = (8, 64)  # rows, columns: 64 pixels of 3 bytes are three cache lines
CO_LOCATED, AVERAGE, MINIMUM = range(3)

_U = np.uint64


class Rule(NamedTuple):
    """What stays the same from frame to frame, see `luminance`, `differ`, `inhibit`, `fire` and `update`.

    `contrast`: whether brightness is taken relative to that of neighbors.
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
    """The state of tiles, bool [tile rows, tile columns] each, except `behind`.

    - `dirty`: tiles that changed
    - `affected`: tiles whose perceived brightness changed (the same array where neighbors don't matter)
    - `active`: tiles that have to be processed
    - `still`: tiles that needn't be processed until they or their neighbors get dirty
    - `behind` int64: number of frames by which a tile's references are behind
    """

    dirty: np.ndarray
    affected: np.ndarray
    active: np.ndarray
    still: np.ndarray
    behind: np.ndarray


class Pixels(NamedTuple):
    """The state of pixels; `difference` has only the rows of a band."""

    plane: np.ndarray
    level: np.ndarray
    reference: np.ndarray
    difference: np.ndarray


@njit
def bounds(tile, shape):
    """First and last row and column of a tile."""
    y, x = tile[0] * TILE[0], tile[1] * TILE[1]
    return y, min(y + TILE[0], shape[0]), x, min(x + TILE[1], shape[1])


@njit
def look(frame, previous, rule, tiles, pixels):
    """Find the tiles that a frame makes dirty and active, and update references; returns whether any are active."""
    width = pixels.level.shape[1]
    changed = find_dirty(frame, previous, frame.shape[1] // width * TILE[1], tiles.dirty)
    follows = rule.everywhere and rule.alpha < 1  # whether references also move in tiles that aren't processed
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


@njit
def find_dirty(frame, previous, tile_bytes, dirty):
    """Mark the tiles that differ from the `previous` frame's; return how many. O(bytes)."""
    count = 0
    for r in range(dirty.shape[0]):
        marks = dirty[r]
        marks[:] = False
        marked = 0
        for y in range(r * TILE[0], min((r + 1) * TILE[0], frame.shape[0])):
            # whole rows while all tiles are clean: memory is read fastest sequentially
            if marked == marks.size or (marked == 0 and not _changed(frame[y], previous[y])):
                continue
            for c in range(marks.size):
                lo, hi = c * tile_bytes, min((c + 1) * tile_bytes, frame.shape[1])
                if not marks[c] and _changed(frame[y, lo:hi], previous[y, lo:hi]):
                    marks[c] = True
                    marked += 1
        count += marked
    return count


@njit
def _changed(row, previous):
    found = False
    for i in range(_U(row.size)):
        found |= row[i] != previous[i]
    return found


@njit
def _wake(rule, tiles):
    """Set which tiles are affected and active: changed ones, those not still, and neighbors that matter."""
    affected, active = tiles.affected, tiles.active
    if rule.contrast:
        spread(tiles.dirty, affected)
    for tile in np.ndindex(active.shape):
        active[tile] = affected[tile] or not tiles.still[tile]
    if rule.method != CO_LOCATED:
        spread(active.copy(), active)
    if TILE[0] % rule.side and rule.method != CO_LOCATED:
        # blocks lie across tiles, and a pixel in a still one may be about to fire as soon as its block lets it
        active[:] = True


@njit
def spread(marks, out):
    """Write to `out` whether each tile or any of its eight neighbors is marked."""
    rows, columns = marks.shape
    for r, c in np.ndindex(marks.shape):
        found = False
        for i in range(max(r - 1, 0), min(r + 2, rows)):
            for j in range(max(c - 1, 0), min(c + 2, columns)):
                found |= marks[i, j]
        out[r, c] = found


@njit
def catch_up(reference, level, alpha, behind, tiles):
    """Update moving averages that are behind, (3.10), by exactly the omitted steps, until none changes a value."""
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
