"""Distances between emulated and real events, and the score that combines them (thesis, section 3.3)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from nvsdata.common.validation import positive
from nvsdata.data.events import Events
from nvsdata.data.frame_edges import frame_edges
from nvsdata.data.recording import Recording, as_events
from nvsdata.metrics.measures import (
    Measure,
    chamfer_measure,
    emd_measure,
    repeatability_measure,
    spikes_of_frames,
    swapped,
)

LAMBDA = math.sqrt(3)
EPSILON = 3.5
BLOCKS = 16


@dataclass(frozen=True, eq=False)
class Distance:
    """Distance between two sequences of events.

    Args:
        value: Mean over the frames that have spikes on both sides; NaN if there are none.
        frames: float64 [frames], the distance in each frame; NaN if a side has no spikes.
        used: Number of frames in the mean.
        empty_emulated: Number of frames without emulated spikes.
        empty_real: Number of frames without real spikes.
        bound: Largest possible difference between `value` and the exact distance (default 0.0: `value` is exact).

    Example:
        >>> real = Events([0, 10], [0, 3], [1, 1], [1, 0], (4, 4))
        >>> float(chamfer(real, real))
        0.0
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
    """The distances between two sequences of events, as `compare` returns them.

    Args:
        chamfer: Chamfer distance from emulated spikes to real ones.
        repeatability: Epsilon repeatability of emulated spikes.
        emd: Earth mover's distance, which is the same in both directions.
        chamfer_back: Chamfer distance from real spikes to emulated ones.
        repeatability_back: Epsilon repeatability of real spikes.
        emulated_events: Numbers of emulated OFF and ON events in the time that both sequences cover.
        real_events: The same numbers of real events.

    Example:
        >>> real = Events([0, 10], [0, 3], [1, 1], [1, 0], (4, 4))
        >>> compare(real, real).emulated_events
        (1, 1)
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
        """1 - repeatability, Chamfer distance and EMD, the input of `score` as in the thesis.

        Smaller is better for all three. Missing emulated events don't increase these distances.
        """
        return 1 - self.repeatability.value, self.chamfer.value, self.emd.value

    @property
    def values_both_ways(self) -> tuple[float, ...]:
        """The distances of `values`, the first two as means over both directions, and `counts_apart`.

        Missing emulated events increase these distances.
        """
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
    """Return the mean distance from each emulated spike to the nearest real one (thesis, eqs. 3.11, 3.12).

    A spike is a pixel whose polarities in a frame don't sum to 0. The distance is Euclidean in (x, y, lambda P_sigma),
    where P_sigma is that sum.

    Args:
        emulated: Emulated events.
        real: Real events, of a sensor of the same size.
        fps: Frames per second; None (default) takes the entire sequence as one frame.
        offset: µs that are added to the times of `real` (default 0).
        weight: Weight lambda (default sqrt(3)).

    Raises:
        ValueError: If the sensors differ, or a setting is out of range.

    Example:
        >>> real = Events([0, 10], [0, 3], [1, 1], [1, 0], (4, 4))
        >>> chamfer(real, real).value
        0.0
    """
    return _measured(emulated, real, fps, offset, [chamfer_measure(weight)])[0]


def epsilon_repeatability(
    emulated: Events | Recording,
    real: Events | Recording,
    *,
    fps: float | None = None,
    offset: int = 0,
    epsilon: float = EPSILON,
) -> Distance:
    """Return the fraction of emulated spikes with a real spike of the same sign nearby (thesis, eqs. 3.13, 3.14).

    Larger values mean that the sequences are closer.

    Args:
        emulated: Emulated events.
        real: Real events, of a sensor of the same size.
        fps: Frames per second; None (default) takes the entire sequence as one frame.
        offset: µs that are added to the times of `real` (default 0).
        epsilon: Radius in pixels (default 3.5).

    Raises:
        ValueError: If the sensors differ, or a setting is out of range.

    Example:
        >>> real = Events([0, 10], [0, 3], [1, 1], [1, 0], (4, 4))
        >>> epsilon_repeatability(real, real).value
        1.0
    """
    return _measured(emulated, real, fps, offset, [repeatability_measure(epsilon)])[0]


def emd(
    emulated: Events | Recording,
    real: Events | Recording,
    *,
    fps: float | None = None,
    offset: int = 0,
    blocks: int = BLOCKS,
    cell: int = 1,
) -> Distance:
    """Return the earth mover's distance of |P_sigma|, summed over a grid of blocks (thesis, eqs. 3.15 to 3.17).

    Surplus mass of one sequence isn't moved (partial matching). A block without spikes of one sequence adds 0.

    The run time grows faster than the square of the number of spikes in a block. With `cell` above 1, the spikes of
    each cell of `cell` x `cell` pixels are moved together, from their center of mass. The `bound` of the result is the
    work of moving them to this center: the exact distance is within `value` ± `bound`.

    Args:
        emulated: Emulated events.
        real: Real events, of a sensor of the same size.
        fps: Frames per second; None (default) takes the entire sequence as one frame.
        offset: µs that are added to the times of `real` (default 0).
        blocks: Number of blocks K, a square number (default 16).
        cell: Side of the cells in pixels (default 1: exact).

    Raises:
        ValueError: If the sensors differ, or a setting is out of range.

    Example:
        >>> a = Events([0], [0], [1], [1], (4, 4))
        >>> b = Events([0], [3], [1], [1], (4, 4))
        >>> emd(a, b, blocks=1).value
        3.0
    """
    return _measured(emulated, real, fps, offset, [emd_measure(blocks, cell)])[0]


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
    """Return all distances between two sequences (thesis, section 3.3), in both directions, and event counts.

    Both sequences are cut into frames, up to the end of the longer one. In each frame, polarity is summed at each
    pixel; a sum other than 0 is a spike. Times of each sequence are relative to its `start`, which is the time of its
    first event unless the sequence was cut or emulated, or its file states another start.

    Args:
        emulated: Emulated events.
        real: Real events, of a sensor of the same size.
        fps: Frames per second (default 30.0); None takes the entire sequence as one frame.
        offset: µs that are added to the times of `real` (default 0).
        weight: Weight lambda of `chamfer` (default sqrt(3)).
        epsilon: Radius of `epsilon_repeatability` in pixels (default 3.5).
        blocks: Number of blocks of `emd`, a square number (default 16).

    Raises:
        ValueError: If the sensors differ, or a setting is out of range.

    Example:
        >>> real = Events([0, 10], [0, 3], [1, 1], [1, 0], (4, 4))
        >>> compare(real, real).values
        (0.0, 0.0, 0.0)
    """
    to_nearest, repeated = chamfer_measure(weight), repeatability_measure(epsilon)
    measures = [to_nearest, repeated, emd_measure(blocks), swapped(to_nearest), swapped(repeated)]
    a, b = as_events(emulated, "emulated"), as_events(real, "real")
    near, same, moved, near_back, same_back = _measured(a, b, fps, offset, measures)
    # the time that both sequences cover, counted from the start of `a`
    begin, end = max(0, offset), min(a.end - a.start, b.end - b.start + offset)
    counts = (event_counts(events, begin - shift, end - shift) for events, shift in ((a, 0), (b, offset)))
    return Comparison(near, same, moved, near_back, same_back, *counts)


def event_counts(events: Events, begin: int, end: int) -> tuple[int, int]:
    """Return the numbers of OFF and of ON events from `begin` to `end`, both included, in µs from the start."""
    first, after = np.searchsorted(events.t, (events.start + begin, events.start + end + 1))
    polarity = events.p[first:after]
    on = int(np.count_nonzero(polarity))
    return polarity.size - on, on


def score(distances: npt.ArrayLike) -> np.ndarray:
    """Return the weighted score of each setting: the mean of its normalized distances (thesis, section 3.3.4).

    Each kind of distance is divided by its L2 norm over all settings.

    Args:
        distances: [settings, distances], such as `Comparison.values` of each setting. Smaller is better for all kinds.
            NaN stands for a setting without a result; it is left out of the norms.

    Returns:
        float64 [settings]; NaN for a setting with NaN. A distance that is 0 for all settings adds 0.

    Raises:
        ValueError: If `distances` has another number of axes.

    Example:
        >>> score([[0.3, 4.0], [0.4, 3.0]]).round(2).tolist()
        [0.7, 0.7]
    """
    table = np.asarray(distances, np.float64)
    if table.ndim != 2:
        raise ValueError(f"distances must be [settings, distances], not {table.shape}")
    norms = np.sqrt(np.nansum(table * table, axis=0))
    normalized = np.divide(table, norms, out=np.zeros_like(table), where=norms > 0)
    return np.asarray(np.where(np.isnan(table).any(1), np.nan, normalized.mean(1)))


def _measured(
    emulated: Events | Recording, real: Events | Recording, fps: float | None, offset: int, measures: list[Measure]
) -> list[Distance]:
    """Return the distance by each measure."""
    a, b = as_events(emulated, "emulated"), as_events(real, "real")
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
