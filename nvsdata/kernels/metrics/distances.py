"""Distances between frames of spikes: the nearest spike of another frame, and the transportation problem.

The nearest spikes are found by a search on the pixel lattice. The transportation problem moves mass between points at
the least cost, by the network simplex method (earth_mover.cpp). Positions outside the frame raise an IndexError, and
columns that differ in length raise a ValueError.
"""

from __future__ import annotations

import numpy as np

from nvsdata.kernels import _native


def sum_polarity(x: np.ndarray, y: np.ndarray, p: np.ndarray, sums: np.ndarray, touched: np.ndarray) -> int:
    """Sum +1 for ON and -1 for OFF at each position (thesis, eq. 3.18) into `sums`, which must be zero.

    Returns the number of positions in `touched`.

    Args:
        x: Columns, int16 or int32 [N].
        y: Rows, of the same type as `x`.
        p: Polarities, uint8 [N].
        sums: Output, int32 or int64 [H, W].
        touched: Output for the positions y W + x of the events, int64 with at least N elements. Positions may occur
            twice.
    """
    count: int = _native.sum_polarity(x, y, p, sums, touched)
    return count


def spikes(sums: np.ndarray, touched: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return positions (x, y) and values of the sums other than 0, in raster order, and set `sums` to 0 again.

    These positions are among the first `count` of `touched`. O(count log count).
    """
    x, y, total = np.empty(count, np.int64), np.empty(count, np.int64), np.empty(count, np.int64)
    n = _native.spikes(sums, touched[:count].copy(), x, y, total)
    return x[:n], y[:n], total[:n]


def nearest_spikes(
    x: np.ndarray,
    y: np.ndarray,
    value: np.ndarray,
    bx: np.ndarray,
    by: np.ndarray,
    bvalue: np.ndarray,
    shape: tuple[int, int],
    weight: float,
    limit: float,
) -> np.ndarray:
    """Return the least cost dx² + dy² + weight (value - value')² of each of N spikes to M other ones, if M > 0.

    Values are int64 and not zero. For a cost above `limit` (squared pixels), some number above `limit` is returned.
    `shape` is (height, width).

    The other spikes are searched in a map of pixels, outward from the spike, until the distance alone exceeds the best
    cost. If the map is empty nearby, cells of 16 pixels are searched outward. O(N + M + H W).
    """
    height, width = shape
    if not (0 <= height < 2**31 and 0 <= width < 2**31):
        raise ValueError(f"a frame can't have the size {width} x {height}")
    best = np.empty(x.size, np.float64)
    _native.nearest(x, y, value, bx, by, bvalue, height, width, weight, limit, best)
    return best


def cancel(place_a: np.ndarray, a: np.ndarray, place_b: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Remove mass that is at the same position on both sides; return the remaining mass of `a` and `b`.

    All arrays are int64, and `place_a` and `place_b` increase. By the triangle inequality, an optimal plan exists that
    doesn't move this mass. O(N + M).
    """
    left_a, left_b = a.copy(), b.copy()
    _native.cancel(place_a, left_a, place_b, left_b)
    return left_a, left_b


def least_work(ax: np.ndarray, ay: np.ndarray, am: np.ndarray, bx: np.ndarray, by: np.ndarray, bm: np.ndarray) -> float:
    """Return the least sum of mass times Euclidean distance that moves min(sum am, sum bm) from a to b.

    This is eq. 3.15 of the thesis.

    `ax`, `ay`, `bx` and `by` are float64; the masses `am` and `bm` are int64. O(N + M) memory: costs are computed again
    at each use, which is as fast as reading a matrix. ValueError if there are no points, and for masses below 1 or with
    a sum of 2^62 or more.
    """
    work: float = _native.least_work(ax, ay, am, bx, by, bm)
    return work
