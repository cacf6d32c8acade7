"""Spikes of a frame (polarity summed at each pixel, P_sigma in section 3.3 of the thesis), and measures between them.

A measure takes emulated spikes, real spikes and the sensor's size. It returns a distance and the bound of its error.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from nvsdata.common.validation import not_negative, whole
from nvsdata.data.events import Events, check_inside
from nvsdata.data.frame_edges import frame_bounds
from nvsdata.kernels.metrics.distances import cancel, least_work, nearest_spikes, sum_polarity
from nvsdata.kernels.metrics.distances import spikes as gather


class Spikes(NamedTuple):
    """Spikes of one frame in raster order.

    Args:
        x: int64 [spikes], pixels.
        y: int64 [spikes], pixels.
        total: int64 [spikes], summed polarity, never 0.
    """

    x: np.ndarray
    y: np.ndarray
    total: np.ndarray

    def __len__(self) -> int:  # number of spikes; the inherited method would count the columns
        return int(self.x.size)

    def take(self, mask: np.ndarray) -> Spikes:
        """Return the spikes selected by a boolean mask."""
        return Spikes(self.x[mask], self.y[mask], self.total[mask])


Measure = Callable[[Spikes, Spikes, tuple[int, int]], tuple[float, float]]


def spikes_of_frames(events: Events, origin: int, edges: np.ndarray) -> Iterator[Spikes]:
    """Yield the spikes of each frame; `edges` are the bounds of frames in µs since `origin`."""
    sums = np.zeros(check_inside(events).sensor_size[::-1], np.int32)
    bounds = frame_bounds(events, origin, edges)
    touched = np.empty(int(np.diff(bounds).max(initial=0)), np.int64)
    for lo, hi in pairwise(bounds):
        count = sum_polarity(events.x[lo:hi], events.y[lo:hi], events.p[lo:hi], sums, touched)
        yield Spikes(*gather(sums, touched, count))


def swapped(measure: Measure) -> Measure:
    """Return the measure from real spikes to emulated ones."""
    return lambda emulated, real, size: measure(real, emulated, size)


def chamfer_measure(weight: float) -> Measure:
    """Return the measure of `chamfer`. ValueError for a negative weight."""
    not_negative("weight", weight)

    def measure(a: Spikes, b: Spikes, size: tuple[int, int]) -> tuple[float, float]:
        return float(np.sqrt(nearest_spikes(*a, *b, size[::-1], weight * weight, np.inf)).mean()), 0.0

    return measure


def repeatability_measure(epsilon: float) -> Measure:
    """Return the measure of `epsilon_repeatability`. ValueError for a negative epsilon."""
    not_negative("epsilon", epsilon)

    def measure(a: Spikes, b: Spikes, size: tuple[int, int]) -> tuple[float, float]:
        # larger than the distance of any two pixels; the distance of spikes of different signs (2 apart) is even larger
        furthest = float(sum(size))
        squared = _largest_square(min(epsilon, furthest))
        signs = np.sign(a.total), np.sign(b.total)
        costs = nearest_spikes(a.x, a.y, signs[0], b.x, b.y, signs[1], size[::-1], furthest**2, squared)
        return float(np.mean(costs <= squared)), 0.0

    return measure


def _largest_square(distance: float) -> int:
    """Return the largest integer whose root is at most `distance`; `distance` ** 2 may be rounded up or down."""
    near = math.floor(distance**2)
    return max(number for number in range(max(near - 1, 0), near + 2) if math.sqrt(number) <= distance)


def emd_measure(blocks: int, cell: int = 1) -> Measure:
    """Return the measure of `emd`. ValueError unless `blocks` is a square number and `cell` is at least 1."""
    whole("cell", cell, 1)
    side = math.isqrt(max(int(blocks), 0))
    if side < 1 or side * side != blocks:
        raise ValueError(f"blocks must be a square number of at least 1, not {blocks}")

    def measure(a: Spikes, b: Spikes, size: tuple[int, int]) -> tuple[float, float]:
        blocks_a, blocks_b = (_block(spikes, size, side) for spikes in (a, b))
        total = bound = 0.0
        for block in np.intersect1d(blocks_a, blocks_b):
            ours, theirs = a.take(blocks_a == block), b.take(blocks_b == block)
            value, most = _emd_of(ours, theirs, size[0], cell)
            total, bound = total + value, bound + most
        return total, bound

    return measure


def _block(spikes: Spikes, size: tuple[int, int], side: int) -> np.ndarray:
    """Return the index of the block that contains each spike, in a grid of `side` x `side` blocks."""
    return np.asarray(spikes.y * side // size[1] * side + spikes.x * side // size[0])


def _emd_of(a: Spikes, b: Spikes, width: int, cell: int) -> tuple[float, float]:
    """Return the distance (thesis, eq. 3.16) for a block with spikes of both sequences, and the bound of its error."""
    mass_a, mass_b = np.abs(a.total), np.abs(b.total)
    flow = min(mass_a.sum(), mass_b.sum())
    left_a, left_b = cancel(a.y * width + a.x, mass_a, b.y * width + b.x, mass_b)
    if not (left_a.any() and left_b.any()):
        return 0.0, 0.0
    ours, theirs = _gathered(a, left_a, cell), _gathered(b, left_b, cell)
    return float(least_work(*ours[:3], *theirs[:3]) / flow), float((ours[3] + theirs[3]) / flow)


def _gathered(spikes: Spikes, mass: np.ndarray, cell: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    """Move the spikes of each cell to their center of mass; spikes without mass are left out.

    Returns x, y and mass of the cells, and the work of the move.
    """
    some = mass > 0
    x, y, mass = spikes.x[some].astype(float), spikes.y[some].astype(float), mass[some]
    if cell == 1:
        return x, y, mass, 0.0
    # a row has fewer than 2^31 cells
    _, of = np.unique((spikes.y[some] // cell).astype(np.int64) << 32 | (spikes.x[some] // cell), return_inverse=True)
    total = np.bincount(of, mass)
    center_x, center_y = np.bincount(of, mass * x) / total, np.bincount(of, mass * y) / total
    work = float((mass * np.hypot(x - center_x[of], y - center_y[of])).sum())
    return center_x, center_y, total.astype(np.int64), work
