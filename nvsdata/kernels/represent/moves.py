"""Events moved to other pixels by a table."""

from __future__ import annotations

import numpy as np

from nvsdata.kernels import _native

_ONE, _SEVERAL = np.uint32(1 << 30), np.uint32(2 << 30)


def move_events(
    t: np.ndarray,
    x: np.ndarray,
    y: np.ndarray,
    p: np.ndarray,
    table: np.ndarray,
    lists: np.ndarray,
    out: tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray],
) -> int:
    """Move each event to a target of its pixel; drop those without any. Return how many are left. O(N).

    `table` and `lists` are those of `move_table`. One of several targets is chosen by a hash of the event's time and
    pixel. `out` has columns with space for N + 1 events. Events outside raise an IndexError.
    """
    count: int = _native.move_events(t, x, y, p, table, lists, *out)
    return count


def move_table(pixels: np.ndarray, targets: np.ndarray, shape: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """Return the table uint32 [H, W] of pixels' targets, and the lists uint32 [K] of pixels with several.

    Args:
        pixels: Number of a pixel, row by row, for each target, int64 [N].
        targets: Number of the target's pixel, int64 [N].
        shape: (H, W), each less than 2^15.

    An entry has 1 or 2 in its two highest bits for one or several targets: row and column, 15 bits each, or the index
    of a list. A list has the number of targets, then their rows and columns.
    """
    height, width = shape
    order = np.argsort(pixels, kind="stable")
    pixels, targets = pixels[order], targets[order]
    places = (targets // width << 15 | targets % width).astype(np.uint32)
    counts = np.bincount(pixels, minlength=height * width)
    table = np.zeros(height * width, np.uint32)
    alone = counts[pixels] == 1
    table[pixels[alone]] = places[alone] | _ONE
    lengths = counts[counts > 1]
    starts = np.cumsum(lengths + 1) - (lengths + 1)
    table[counts > 1] = starts.astype(np.uint32) | _SEVERAL
    lists = np.empty(int((lengths + 1).sum()), np.uint32)
    lists[starts] = lengths
    heads = np.zeros(lists.size, np.bool_)
    heads[starts] = True
    lists[~heads] = places[~alone]
    return table.reshape(shape), lists
