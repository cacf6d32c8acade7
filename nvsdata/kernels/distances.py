"""Spikes of a frame on the pixel lattice, and the nearest spike of another frame to each."""

from __future__ import annotations

import numpy as np

from nvsdata.kernels.compiling import njit

MARGIN = 6  # pixels around a map, and the distance up to which neighbors are looked up one by one
CELL = 16  # side in pixels of the cells that are searched beyond that
UNASKED = 21  # the pixel itself and the twenty nearest, which are always looked at
SPARSE = 64  # pixels per spike from which on cells are searched immediately

_U = np.uint64


@njit
def sum_polarity(x, y, p, sums, touched):
    """P_sigma: +1 for ON and -1 for OFF summed at each position, (3.18), into `sums` [H, W], which must be zero.

    Fills `touched` int64 [N] with the positions y W + x, and returns how many; some may occur twice.
    """
    width = sums.shape[1]
    flat = sums.reshape(-1)
    count = 0
    for i in range(_U(x.size)):
        place = np.int64(y[i]) * width + x[i]
        if flat[place] == 0:
            touched[count] = place
            count += 1
        flat[place] += 2 * np.int64(p[i]) - 1
    return count


@njit
def spikes(sums, touched, count):
    """Positions (x, y) and values of the sums other than 0, in raster order; `sums` is zeroed. O(count log count)."""
    flat = sums.reshape(-1)
    places = np.sort(touched[:count])
    x, y, total = np.empty(count, np.int64), np.empty(count, np.int64), np.empty(count, np.int64)
    n = 0
    for place in places:
        if flat[place] != 0:
            x[n], y[n], total[n] = place % sums.shape[1], place // sums.shape[1], flat[place]
            flat[place] = 0
            n += 1
    return x[:n], y[:n], total[:n]


def _around() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Neighbors within `MARGIN` in order of distance: dy, dx and squared distances."""
    dy, dx = np.mgrid[-MARGIN : MARGIN + 1, -MARGIN : MARGIN + 1].reshape(2, -1)
    squares = dx * dx + dy * dy
    order = np.argsort(squares, kind="stable")[: np.count_nonzero(squares <= MARGIN * MARGIN)]
    return dy[order], dx[order], squares[order].astype(np.float64)


_DY, _DX, _SQUARES = _around()


@njit
def nearest(x, y, value, bx, by, bvalue, shape, weight, limit):
    """For each of N spikes the least dx² + dy² + weight (value - value')² to any of M others, if M > 0.

    Values are not zero. A cost beyond `limit` (squared pixels) is returned as some number beyond it.
    Others are looked up in a map, outward from the pixel, until the distance alone exceeds the best cost;
    where the map is empty nearby, cells of `CELL` pixels are searched, outward, without empty ones. O(N + M + H W).
    """
    height, width = shape
    best = np.full(x.size, limit + 1)
    if bx.size * SPARSE < height * width:
        _search_cells(x, y, value, bx, by, bvalue, shape, weight, -1, best)
        return best
    stride = width + 2 * MARGIN
    # an empty pixel is infinitely far: so no branch tests for it, which would be unpredictable
    lattice = np.full((height + 2 * MARGIN) * stride, np.float32(np.inf))
    for j in range(_U(bx.size)):
        lattice[(by[j] + MARGIN) * stride + bx[j] + MARGIN] = bvalue[j]
    squares = _SQUARES
    steps = np.empty(_DY.size, np.int64)
    for k in range(steps.size):
        steps[k] = _DY[k] * stride + _DX[k]
    lonely = 0
    for i in range(_U(x.size)):
        home = (y[i] + MARGIN) * stride + x[i] + MARGIN
        least = best[i]
        # whole numbers: their differences are exact in float32
        own = np.float32(value[i])
        apart = np.float64(own - lattice[_U(home)])
        least = min(least, weight * apart * apart)
        # all but the middle come in fours of equal distance; the first are looked at in any case, because when to
        # stop is unpredictable, and a wrong prediction costs more than they do
        for k in range(_U(1), _U(UNASKED), _U(4)):
            apart = _apart(lattice, steps, home, k, own)
            least = min(least, squares[k] + weight * apart * apart)
        for k in range(_U(UNASKED), _U(steps.size), _U(4)):
            if squares[k] >= least:
                break
            apart = _apart(lattice, steps, home, k, own)
            least = min(least, squares[k] + weight * apart * apart)
        best[i] = least
        lonely += least > MARGIN * MARGIN
    if lonely and limit > MARGIN * MARGIN:
        _search_cells(x, y, value, bx, by, bvalue, shape, weight, MARGIN * MARGIN, best)
    return best


@njit(inline="always")
def _apart(lattice, steps, home, k, own):
    """Distance of `own` from the nearest value at the four steps from `k` on."""
    one, two = abs(own - lattice[_U(home + steps[k])]), abs(own - lattice[_U(home + steps[k + _U(1)])])
    three, four = abs(own - lattice[_U(home + steps[k + _U(2)])]), abs(own - lattice[_U(home + steps[k + _U(3)])])
    return np.float64(min(min(one, two), min(three, four)))


@njit
def _search_cells(x, y, value, bx, by, bvalue, shape, weight, settled, best):
    """Search cells, and lower `best` where it is above `settled`."""
    rows, columns = (shape[0] + CELL - 1) // CELL, (shape[1] + CELL - 1) // CELL
    ends = np.zeros(rows * columns + 1, np.int64)
    for j in range(bx.size):
        ends[by[j] // CELL * columns + bx[j] // CELL + 1] += 1
    ends = np.cumsum(ends)
    order, place = np.empty(bx.size, np.int64), ends[:-1].copy()
    for j in range(bx.size):
        cell = by[j] // CELL * columns + bx[j] // CELL
        order[place[cell]] = j
        place[cell] += 1
    for i in range(x.size):
        if best[i] <= settled:
            continue
        row, column = y[i] // CELL, x[i] // CELL
        least = best[i]
        for ring in range(max(rows, columns)):
            # everything in this ring of cells is at least this far away
            gap = float(max(ring - 1, 0) * CELL + (ring > 0))
            if gap * gap >= least:
                break
            for r in range(max(row - ring, 0), min(row + ring + 1, rows)):
                edge = r in (row - ring, row + ring)
                for c in range(column - ring, column + ring + 1, 1 if edge or ring == 0 else 2 * ring):
                    if c < 0 or c >= columns:
                        continue
                    cell = r * columns + c
                    for k in range(ends[cell], ends[cell + 1]):
                        j = order[k]
                        dx, dy, apart = float(x[i] - bx[j]), float(y[i] - by[j]), float(value[i] - bvalue[j])
                        least = min(least, dx * dx + dy * dy + weight * apart * apart)
        best[i] = least


@njit
def cancel(place_a, a, place_b, b):
    """Remove mass that lies at the same place on both sides; returns what is left of `a` and `b`.

    `place_a` and `place_b` increase. By the triangle inequality some optimal plan moves none of it. O(N + M).
    """
    a, b = a.copy(), b.copy()
    i = j = 0
    while i < a.size and j < b.size:
        if place_a[i] < place_b[j]:
            i += 1
        elif place_a[i] > place_b[j]:
            j += 1
        else:
            same = min(a[i], b[j])
            a[i] -= same
            b[j] -= same
            i += 1
            j += 1
    return a, b
