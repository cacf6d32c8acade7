"""PIX2NVS, one frame at a time (thesis, section 3.2): tiles that did not change are only compared.

Frames are uint8 [H, W * C]. `plane`, `level`, `reference` and `difference` are [H, W] of one float type. Marks of tiles
are bool [tile rows, tile columns]. Steps that need no neighbors are done in bands of rows, so that a band stays in the
cache from bytes to events.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from nvsdata.kernels import _native

TABLE_SIZE = 255_001  # luminance in thousandths: 299 r + 587 g + 114 b
CO_LOCATED, AVERAGE, MINIMUM = range(3)
INTERPOLATED, RANDOM, AT_ONCE = range(3)


class Rule(NamedTuple):
    """Settings that stay the same from frame to frame. Equations are those of the thesis.

    - `contrast`: whether levels are contrasts to the neighbors
    - `table`, `t_log`, `slope`: see `luminance`
    - `method`: one of the first three constants above (eq. 3.3 and 3.4)
    - `sensitivity`: factors of the differences, [H, W] or empty
    - `side`: side in pixels of the blocks in which one pixel fires (eq. 3.5)
    - `threshold`: difference at which a pixel fires; `most`: its largest number of events (eq. 3.6 and 3.8)
    - `timing`: one of the other three constants above; the k-th event is at k T threshold / |d|, at random, or at 0
    - `alpha`: weight of the level in a new reference; `everywhere`: whether pixels that don't fire also get a new
      reference (eq. 3.9 and 3.10)
    - `calm`: difference below which a pixel of a still tile doesn't fire
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
    - `affected`: tiles whose perceived brightness changed (the same array as `dirty` if neighbors don't matter)
    - `active`: tiles that have to be processed
    - `still`: tiles that needn't be processed until they or their neighbors get dirty
    - `behind` int64: number of frames since the references of a tile were updated
    """

    dirty: np.ndarray
    affected: np.ndarray
    active: np.ndarray
    still: np.ndarray
    behind: np.ndarray


class Pixels(NamedTuple):
    """The state of pixels, arrays of one float type. Equations are those of the thesis.

    - `plane`: perceived brightness (eq. 3.1)
    - `level`: the same, or its contrast with the neighbors (eq. 3.2)
    - `reference`: level with which the next frame is compared
    - `difference`: level minus reference (eq. 3.3 or 3.4), only for the rows of one band
    """

    plane: np.ndarray
    level: np.ndarray
    reference: np.ndarray
    difference: np.ndarray


def mark_tiles(frame: np.ndarray, previous: np.ndarray, rule: Rule, tiles: Tiles, pixels: Pixels) -> bool:
    """Find the tiles that are dirty and active in a frame, and update references; return whether any tile is active."""
    settings = rule.contrast, rule.method, rule.side, rule.alpha, rule.everywhere
    found: bool = _native.mark_tiles(frame, previous, *settings, *tiles, pixels.level, pixels.reference)
    return found


def luminance(frame: np.ndarray, first_weight: int, rule: Rule, tiles: np.ndarray, plane: np.ndarray) -> None:
    """Write the perceived brightness of pixels of one byte (gray) or three to `plane`, in marked tiles.

    For one byte it is the rule's table[byte]. For three bytes it is table[1000 q] with q = 0.299 r + 0.587 g + 0.114 b,
    or, if the table is empty, the logarithm of q (thesis, eq. 3.1). `first_weight` is the weight of the first byte in
    thousandths: 299 for r, g, b, and 114 for b, g, r.
    """
    _native.luminance(frame, first_weight, rule.table, rule.t_log, rule.slope, tiles, plane)


def contrast(
    plane: np.ndarray, tiles: np.ndarray, then_log: bool, t_log: float, slope: float, level: np.ndarray
) -> None:
    """Write the contrast of each pixel, the mean absolute difference from its four neighbors, to `level`.

    This is eq. 3.2 of the thesis. If `then_log`, the result is mapped by eq. 3.1, with the logarithm of the C library.
    Borders are replicated. `plane` and `level` are float64.
    """
    _native.contrast(plane, tiles, then_log, t_log, slope, level)


def step(
    frame: np.ndarray,
    previous: np.ndarray,
    first_weight: int,
    rule: Rule,
    tiles: Tiles,
    pixels: Pixels,
    span: int,
    seed: int,
    keys: np.ndarray,
) -> tuple[np.ndarray, int]:
    """Process a frame `span` µs after the previous one; return the keys (see `read_keys`) and the number of its events.

    If `frame` is empty, `mark_tiles` was called before, and `plane` and `level` are up to date. All remaining work is
    done in one call, because each call releases Python's lock and waits to get it back. Keys are written to `keys` or,
    if that is too short, to a longer array. `seed` is the seed of random times. O(bytes + active pixels + events).
    """
    count, longer = _native.next_frame(frame, previous, first_weight, *rule, *tiles, *pixels, span, seed, keys)
    return keys if longer is None else longer, count
