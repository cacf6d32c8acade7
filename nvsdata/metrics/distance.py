"""Chamfer distance, epsilon repeatability and earth mover's distance (thesis 3.3.1 to 3.3.3)."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from nvsdata.common.validation import not_negative, positive, whole
from nvsdata.data.events import Events
from nvsdata.data.frame_edges import frame_edges
from nvsdata.data.recording import Recording, as_events
from nvsdata.kernels.metrics.distances import cancel, nearest
from nvsdata.kernels.metrics.earth_mover import least_work
from nvsdata.metrics.polarity import Spikes, spikes_of_frames

LAMBDA = math.sqrt(3)
EPSILON = 3.5
BLOCKS = 16
Measure = Callable[[Spikes, Spikes, tuple[int, int]], tuple[float, float]]  # a distance, and how wrong it may be


@dataclass(frozen=True, eq=False)
class Distance:
    """A distance between two sequences.

    - `value`: mean over the frames that have spikes on both sides; NaN if there are none
    - `frames`: float64 [frames], the distance in each frame; NaN if a side is empty
    - `used`: number of frames in the mean
    - `empty_emulated`, `empty_real`: number of frames without emulated or real spikes
    - `bound`: how far `value` may be from the exact one (default 0.0: it is exact)
    """

    value: float
    frames: np.ndarray
    used: int
    empty_emulated: int
    empty_real: int
    bound: float = 0.0

    def __float__(self) -> float:
        return self.value


@dataclass(frozen=True, eq=False)
class Comparison:
    """The distances between two sequences; see `compare`.

    - `chamfer`, `repeatability`, `emd`: a `Distance` each, from emulated spikes to real ones
    - `chamfer_back`, `repeatability_back`: from real spikes to emulated ones (EMD is the same both ways)
    - `emulated_events`, `real_events`: numbers of OFF and of ON events in the time that both sides cover
    """

    chamfer: Distance
    repeatability: Distance
    emd: Distance
    chamfer_back: Distance
    repeatability_back: Distance
    emulated_events: tuple[int, int]
    real_events: tuple[int, int]

    @property
    def values(self) -> tuple[float, float, float]:
        """1 - repeatability, Chamfer, EMD: input for `score`, as in the thesis; smaller is better for all three.

        Events that are missing cost nothing here.
        """
        return 1 - self.repeatability.value, self.chamfer.value, self.emd.value

    @property
    def values_both_ways(self) -> tuple[float, ...]:
        """The same, the first two as means of both ways, and `counts_apart`: here missing events cost, too."""
        repeated = (self.repeatability.value + self.repeatability_back.value) / 2
        chamfer = (self.chamfer.value + self.chamfer_back.value) / 2
        return 1 - repeated, chamfer, self.emd.value, *self.counts_apart

    @property
    def counts_apart(self) -> tuple[float, float]:
        """|ln((emulated + 1) / (real + 1))| of OFF and of ON events: 0 for equal numbers, 0.69 for twice as many."""
        pairs = zip(self.emulated_events, self.real_events, strict=True)
        off, on = (abs(math.log((ours + 1) / (theirs + 1))) for ours, theirs in pairs)
        return off, on


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
    cell: int = 1,
) -> Distance:
    """Earth mover's distance of |P_sigma|, summed over a grid of K = `blocks` blocks (eqs. 3.15 to 3.17).

    Surplus mass on one side isn't moved (partial matching); a block that is empty on one side adds 0.

    The time grows faster than the square of the spikes in a block. With `cell` above 1, the spikes of each cell of that
    many pixels are moved together, from their center of mass. What is lost thereby is no more than the way from the
    spikes to these centers, which is the result's `bound`: the exact distance is within `value` ± `bound`.

    - `emulated`, `real`, `offset`: see `compare`
    - `fps`: frames per second; None (default) takes the whole sequence as one frame
    - `blocks`: number of blocks, a square number (default 16)
    - `cell`: side of the cells in pixels (default 1: exact)

    Raises what `compare` raises.
    """
    return _measure(emulated, real, fps, offset, [_emd(blocks, cell)])[0]


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
    """All three distances between two sequences (thesis 3.3.1 to 3.3.3), those of spikes both ways, and event counts.

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
    to_nearest, repeated = _chamfer(weight), _repeatability(epsilon)
    measures = [to_nearest, repeated, _emd(blocks), _back(to_nearest), _back(repeated)]
    a, b = as_events(emulated), as_events(real)
    near, same, moved, near_back, same_back = _measure(a, b, fps, offset, measures)
    # the time that both sides cover, from the beginning of `a`
    begin, end = max(0, offset), min(a.end - a.start, b.end - b.start + offset)
    counts = (event_counts(events, begin - shift, end - shift) for events, shift in ((a, 0), (b, offset)))
    return Comparison(near, same, moved, near_back, same_back, *counts)


def event_counts(events: Events, begin: int, end: int) -> tuple[int, int]:
    """Numbers of OFF and of ON events from `begin` to `end`, both included, in µs from the start."""
    first, after = np.searchsorted(events.t, (events.start + begin, events.start + end + 1))
    polarity = events.p[first:after]
    on = int(np.count_nonzero(polarity))
    return polarity.size - on, on


def _measure(
    emulated: Events | Recording, real: Events | Recording, fps: float | None, offset: int, measures: list[Measure]
) -> list[Distance]:
    a, b = as_events(emulated), as_events(real)
    if a.sensor_size != b.sensor_size:
        raise ValueError(f"events of different sensors can't be compared: {a.sensor_size} and {b.sensor_size}")
    if fps is not None:
        positive("fps", fps)
    edges = frame_edges(max(a.end - a.start, b.end - b.start + offset), fps)
    pairs = zip(spikes_of_frames(a, a.start, edges), spikes_of_frames(b, b.start - offset, edges), strict=True)
    found = np.full((len(measures), edges.size - 1, 2), np.nan)
    empty = np.zeros(2, int)
    for n, (ours, theirs) in enumerate(pairs):
        empty += (len(ours) == 0, len(theirs) == 0)
        if len(ours) and len(theirs):
            found[:, n] = [measure(ours, theirs, a.sensor_size) for measure in measures]
    used = ~np.isnan(found[0, :, 0])
    counts = int(used.sum()), int(empty[0]), int(empty[1])
    means = found[:, used].mean(1) if used.any() else np.full((len(measures), 2), math.nan)
    return [
        Distance(float(value), frames, *counts, float(bound))
        for (value, bound), frames in zip(means, found[..., 0], strict=True)
    ]


def _back(measure: Measure) -> Measure:
    """From real spikes to emulated ones."""
    return lambda emulated, real, size: measure(real, emulated, size)


def _chamfer(weight: float) -> Measure:
    not_negative("weight", weight)

    def measure(a: Spikes, b: Spikes, size: tuple[int, int]) -> tuple[float, float]:
        return float(np.sqrt(nearest(*a, *b, size[::-1], weight * weight, np.inf)).mean()), 0.0

    return measure


def _repeatability(epsilon: float) -> Measure:
    not_negative("epsilon", epsilon)

    def measure(a: Spikes, b: Spikes, size: tuple[int, int]) -> tuple[float, float]:
        # no two pixels are as far apart; different signs, which are 2 apart, are even further
        furthest = float(sum(size))
        squared = _largest_square(min(epsilon, furthest))
        signs = np.sign(a.total), np.sign(b.total)
        costs = nearest(a.x, a.y, signs[0], b.x, b.y, signs[1], size[::-1], furthest**2, squared)
        return float(np.mean(costs <= squared)), 0.0

    return measure


def _largest_square(distance: float) -> int:
    """The largest whole number whose root is at most `distance`, whose own square may be rounded to either side."""
    near = math.floor(distance**2)
    return max(number for number in range(max(near - 1, 0), near + 2) if math.sqrt(number) <= distance)


def _emd(blocks: int, cell: int = 1) -> Measure:
    whole("cell", cell, 1)
    side = math.isqrt(max(int(blocks), 0))
    if side < 1 or side * side != blocks:
        raise ValueError(f"blocks must be a square number of at least 1, not {blocks}")

    def measure(a: Spikes, b: Spikes, size: tuple[int, int]) -> tuple[float, float]:
        blocks_a, blocks_b = (_block(spikes, size, side) for spikes in (a, b))
        total = bound = 0.0
        for block in np.intersect1d(blocks_a, blocks_b):
            ours, theirs = _where(a, blocks_a == block), _where(b, blocks_b == block)
            value, most = _emd_of(ours, theirs, size[0], cell)
            total, bound = total + value, bound + most
        return total, bound

    return measure


def _block(spikes: Spikes, size: tuple[int, int], side: int) -> np.ndarray:
    """Index of the block, of side x side, that contains each spike."""
    return np.asarray(spikes.y * side // size[1] * side + spikes.x * side // size[0])


def _where(spikes: Spikes, mask: np.ndarray) -> Spikes:
    return Spikes(spikes.x[mask], spikes.y[mask], spikes.total[mask])


def _emd_of(a: Spikes, b: Spikes, width: int, cell: int) -> tuple[float, float]:
    """Eq. (3.16), for spikes on both sides, and how wrong it may be."""
    mass_a, mass_b = np.abs(a.total), np.abs(b.total)
    flow = min(mass_a.sum(), mass_b.sum())
    left_a, left_b = cancel(a.y * width + a.x, mass_a, b.y * width + b.x, mass_b)
    if not (left_a.any() and left_b.any()):
        return 0.0, 0.0
    ours, theirs = _gathered(a, left_a, cell), _gathered(b, left_b, cell)
    return float(least_work(*ours[:3], *theirs[:3]) / flow), float((ours[3] + theirs[3]) / flow)


def _gathered(spikes: Spikes, mass: np.ndarray, cell: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    """x, y and masses of the spikes with mass, those of each cell in its center of mass; and the work of that."""
    some = mass > 0
    x, y, mass = spikes.x[some].astype(float), spikes.y[some].astype(float), mass[some]
    if cell == 1:
        return x, y, mass, 0.0
    # a row of cells is shorter than 2^31 cells
    _, of = np.unique((spikes.y[some] // cell).astype(np.int64) << 32 | (spikes.x[some] // cell), return_inverse=True)
    total = np.bincount(of, mass)
    center_x, center_y = np.bincount(of, mass * x) / total, np.bincount(of, mass * y) / total
    work = float((mass * np.hypot(x - center_x[of], y - center_y[of])).sum())
    return center_x, center_y, total.astype(np.int64), work
