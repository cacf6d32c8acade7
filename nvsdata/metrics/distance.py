"""Chamfer distance, epsilon repeatability and earth mover's distance (thesis 3.3.1 to 3.3.3)."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from nvsdata.common.validation import not_negative, positive
from nvsdata.data.events import Events
from nvsdata.data.frame_edges import frame_edges
from nvsdata.data.recording import Recording, as_events
from nvsdata.kernels.distances import cancel, nearest
from nvsdata.kernels.earth_mover import least_work
from nvsdata.metrics.polarity import Spikes, spikes_of_frames

LAMBDA = math.sqrt(3)
EPSILON = 3.5
BLOCKS = 16
Measure = Callable[[Spikes, Spikes, tuple[int, int]], float]


@dataclass(frozen=True, eq=False)
class Distance:
    """A distance between two sequences.

    - `value`: mean over the frames that have spikes on both sides; NaN if there are none
    - `frames`: float64 [frames], the distance in each frame; NaN if a side is empty
    - `used`: number of frames in the mean
    - `empty_emulated`, `empty_real`: number of frames without emulated or real spikes
    """

    value: float
    frames: np.ndarray
    used: int
    empty_emulated: int
    empty_real: int

    def __float__(self) -> float:
        return self.value


@dataclass(frozen=True, eq=False)
class Comparison:
    """The three distances between two sequences; see `compare`.

    - `chamfer`, `repeatability`, `emd`: a `Distance` each
    """

    chamfer: Distance
    repeatability: Distance
    emd: Distance

    @property
    def values(self) -> tuple[float, float, float]:
        """1 - repeatability, Chamfer, EMD: input for `score`; smaller is better for all three."""
        return 1 - self.repeatability.value, self.chamfer.value, self.emd.value


def chamfer(
    emulated: Events | Recording,
    real: Events | Recording,
    *,
    fps: float | None = None,
    offset: int = 0,
    weight: float = LAMBDA,
) -> Distance:
    """Mean distance in (x, y, lambda P_sigma) from each emulated spike to the nearest real one (eqs. 3.11, 3.12).

    - `emulated`, `real`, `offset`: see `compare`
    - `fps`: frames per second; None (default) takes the whole sequence as one frame
    - `weight`: lambda (default sqrt(3))

    Raises what `compare` raises.
    """
    return _measure(emulated, real, fps, offset, [_chamfer(weight)])[0]


def epsilon_repeatability(
    emulated: Events | Recording,
    real: Events | Recording,
    *,
    fps: float | None = None,
    offset: int = 0,
    epsilon: float = EPSILON,
) -> Distance:
    """Share of emulated spikes with a real one of the same sign within `epsilon` pixels (eqs. 3.13, 3.14).

    Larger values mean closer sequences.

    - `emulated`, `real`, `offset`: see `compare`
    - `fps`: frames per second; None (default) takes the whole sequence as one frame
    - `epsilon`: radius in pixels (default 3.5)

    Raises what `compare` raises.
    """
    return _measure(emulated, real, fps, offset, [_repeatability(epsilon)])[0]


def emd(
    emulated: Events | Recording,
    real: Events | Recording,
    *,
    fps: float | None = None,
    offset: int = 0,
    blocks: int = BLOCKS,
) -> Distance:
    """Exact earth mover's distance of |P_sigma|, summed over a grid of K = `blocks` blocks (eqs. 3.15 to 3.17).

    Surplus mass on one side isn't moved (partial matching); a block that is empty on one side adds 0.

    - `emulated`, `real`, `offset`: see `compare`
    - `fps`: frames per second; None (default) takes the whole sequence as one frame
    - `blocks`: number of blocks, a square number (default 16)

    Raises what `compare` raises.
    """
    return _measure(emulated, real, fps, offset, [_emd(blocks)])[0]


def compare(
    emulated: Events | Recording,
    real: Events | Recording,
    fps: float | None = 30.0,
    *,
    offset: int = 0,
    weight: float = LAMBDA,
    epsilon: float = EPSILON,
    blocks: int = BLOCKS,
) -> Comparison:
    """All three distances between two sequences (thesis 3.3.1 to 3.3.3).

    Both sequences are cut into frames, up to the end of the longer one. In each frame polarity is summed at each
    position; a sum other than 0 is a spike. Each sequence's time counts from its `start`: that of its first event,
    unless it was cut or emulated, or its file states another one.

    - `emulated`, `real`: `Events` or `Recording`
    - `fps`: frames per second (default 30.0); None takes the whole sequence as one frame
    - `offset`: µs added to the times of `real` (default 0)
    - `weight`: lambda of `chamfer` (default sqrt(3))
    - `epsilon`: radius of `epsilon_repeatability` in pixels (default 3.5)
    - `blocks`: number of blocks of `emd`, a square number (default 16)

    Raises ValueError for different sensors and settings out of range.
    """
    measures = [_chamfer(weight), _repeatability(epsilon), _emd(blocks)]
    return Comparison(*_measure(emulated, real, fps, offset, measures))


def _measure(
    emulated: Events | Recording, real: Events | Recording, fps: float | None, offset: int, measures: list[Measure]
) -> list[Distance]:
    a, b = as_events(emulated), as_events(real)
    if a.sensor_size != b.sensor_size:
        raise ValueError(f"events of different sensors can't be compared: {a.sensor_size} and {b.sensor_size}")
    if fps is not None:
        positive("fps", fps)
    edges = frame_edges(max(a.end - a.start, b.end - b.start + offset, 0), fps)
    pairs = zip(spikes_of_frames(a, a.start, edges), spikes_of_frames(b, b.start - offset, edges), strict=True)
    found = np.full((len(measures), edges.size - 1), np.nan)
    empty = np.zeros(2, int)
    for n, (ours, theirs) in enumerate(pairs):
        empty += (len(ours) == 0, len(theirs) == 0)
        if len(ours) and len(theirs):
            found[:, n] = [measure(ours, theirs, a.sensor_size) for measure in measures]
    used = ~np.isnan(found[0])
    return [
        Distance(
            float(row[used].mean()) if used.any() else math.nan, row, int(used.sum()), int(empty[0]), int(empty[1])
        )
        for row in found
    ]


def _chamfer(weight: float) -> Measure:
    not_negative("weight", weight)

    def measure(a: Spikes, b: Spikes, size: tuple[int, int]) -> float:
        return float(np.sqrt(nearest(*a, *b, size[::-1], weight * weight, np.inf)).mean())

    return measure


def _repeatability(epsilon: float) -> Measure:
    not_negative("epsilon", epsilon)
    squared = epsilon * epsilon

    def measure(a: Spikes, b: Spikes, size: tuple[int, int]) -> float:
        # different signs are never within epsilon
        costs = nearest(
            a.x, a.y, np.sign(a.total), b.x, b.y, np.sign(b.total), size[::-1], 4 * float(sum(size)) ** 2, squared
        )
        return float(np.mean(costs <= squared))

    return measure


def _emd(blocks: int) -> Measure:
    side = math.isqrt(max(int(blocks), 0))
    if side < 1 or side * side != blocks:
        raise ValueError(f"blocks must be a square number of at least 1, not {blocks}")

    def measure(a: Spikes, b: Spikes, size: tuple[int, int]) -> float:
        blocks_a, blocks_b = (_block(spikes, size, side) for spikes in (a, b))
        total = 0.0
        for block in np.intersect1d(blocks_a, blocks_b):
            ours, theirs = _where(a, blocks_a == block), _where(b, blocks_b == block)
            total += _emd_of(ours, theirs, size[0])
        return total

    return measure


def _block(spikes: Spikes, size: tuple[int, int], side: int) -> np.ndarray:
    """Index of the block, of side x side, that contains each spike."""
    return np.asarray(spikes.y * side // size[1] * side + spikes.x * side // size[0])


def _where(spikes: Spikes, mask: np.ndarray) -> Spikes:
    return Spikes(spikes.x[mask], spikes.y[mask], spikes.total[mask])


def _emd_of(a: Spikes, b: Spikes, width: int) -> float:
    """Eq. (3.16), for spikes on both sides."""
    mass_a, mass_b = np.abs(a.total), np.abs(b.total)
    flow = min(mass_a.sum(), mass_b.sum())
    left_a, left_b = cancel(a.y * width + a.x, mass_a, b.y * width + b.x, mass_b)
    some_a, some_b = left_a > 0, left_b > 0
    if not (some_a.any() and some_b.any()):
        return 0.0
    points = (
        column
        for spikes, left, some in ((a, left_a, some_a), (b, left_b, some_b))
        for column in (spikes.x[some].astype(float), spikes.y[some].astype(float), left[some])
    )
    return float(least_work(*points) / flow)
