"""Distances between frames of spikes: the nearest spike of another frame, and the transportation problem.

The former searches the pixel lattice. The latter moves mass between points at the least cost by the network simplex
method (earth_mover.cpp). IndexError for what is outside the frame, ValueError for columns that differ in length.
"""

from __future__ import annotations

import numpy as np

from nvsdata.kernels import _native


def sum_polarity(x: np.ndarray, y: np.ndarray, p: np.ndarray, sums: np.ndarray, touched: np.ndarray) -> int:
    """Sum +1 for ON and -1 for OFF at each position, P_sigma of (3.18), into `sums` [H, W], which must be zero.

    Fills `touched` int64 [N] with the positions y W + x, and returns their number; some may occur twice.

    Args:
        x: int16 or int32 [N].
        y: of the same type.
        p: uint8 [N].
        sums: int32 or int64.
        touched: of at least N elements.
    """
    count: int = _native.sum_polarity(x, y, p, sums, touched)
    return count


def spikes(sums: np.ndarray, touched: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return positions (x, y) and values of the sums other than 0, in raster order; set `sums` to 0 again.

    They are among the first `count` positions of `touched`. O(count log count).
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
    """Return for each of N spikes the least dx² + dy² + weight (value - value')² to any of M others, if M > 0.

    Values are int64, not zero. A cost beyond `limit` (squared pixels) is returned as some number beyond it. `shape` is
    (height, width).

    Others are looked up in a map, outward from the pixel, until the distance alone exceeds the best cost; where the map
    is empty nearby, cells of 16 pixels are searched, outward. O(N + M + H W).
    """
    height, width = shape
    if not (0 <= height < 2**31 and 0 <= width < 2**31):
        raise ValueError(f"no frame has the size {width} x {height}")
    best = np.empty(x.size, np.float64)
    _native.nearest(x, y, value, bx, by, bvalue, height, width, weight, limit, best)
    return best


def cancel(place_a: np.ndarray, a: np.ndarray, place_b: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Remove mass that lies at the same place on both sides; return what is left of `a` and `b`, all of them int64.

    `place_a` and `place_b` increase. By the triangle inequality some optimal plan moves none of it. O(N + M).
    """
    left_a, left_b = a.copy(), b.copy()
    _native.cancel(place_a, left_a, place_b, left_b)
    return left_a, left_b


def least_work(ax: np.ndarray, ay: np.ndarray, am: np.ndarray, bx: np.ndarray, by: np.ndarray, bm: np.ndarray) -> float:
    """Return the least sum of mass times Euclidean distance that moves min(sum am, sum bm) from a to b, (3.15).

    `ax`, `ay`, `bx`, `by` are float64, `am`, `bm` int64. O(N + M) memory; costs are computed again at each use, which
    is no slower than reading a matrix. ValueError for no points, and for masses below 1 or with a sum of 2^62 or more.
    """
    work: float = _native.least_work(ax, ay, am, bx, by, bm)
    return work
