"""Pareto fronts and scaling exponents of measurements."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import groupby

import numpy as np

from nvsdata.benchmarks.measurement import OURS, Measurement
from nvsdata.plots import pareto_front

SMALL = 1e-4  # s; below, the constant cost of a call hides the growth
BENT = 0.25  # by which the exponent of the larger half may exceed 1 and the exponent of the smaller half


def by_benchmark(measurements: Sequence[Measurement]) -> list[list[Measurement]]:
    """Group measurements by benchmark.

    Benchmarks are in the order of their first measurement; measurements of a benchmark keep their order.
    """
    ordered = sorted(range(len(measurements)), key=lambda i: _first(measurements, i))
    return [
        [measurements[i] for i in group]
        for _, group in groupby(ordered, key=lambda i: (measurements[i].task, measurements[i].benchmark))
    ]


def _first(measurements: Sequence[Measurement], at: int) -> tuple[int, int]:
    benchmark = measurements[at].task, measurements[at].benchmark
    return next(i for i, one in enumerate(measurements) if (one.task, one.benchmark) == benchmark), at


def is_scaling(measurements: Sequence[Measurement]) -> bool:
    """Return whether a benchmark is measured at several sizes, so that its axis is one of the sizes."""
    return any(one.axis in one.size for one in measurements)


def is_tradeoff(measurements: Sequence[Measurement]) -> bool:
    """Return whether a setting trades time for accuracy, so that the errors of nvsdata differ along the axis."""
    ours = [one for one in measurements if one.library == OURS and one.axis]
    return not is_scaling(measurements) and len({one.error for one in ours if one.error is not None}) > 1


def pareto_indices(points: Sequence[tuple[float, float]]) -> list[int]:
    """Return the indices of the points on the Pareto front of error and time, sorted by error.

    Args:
        points: (error, seconds) of each measurement.

    Example:
        >>> pareto_indices([(0.0, 3.0), (0.1, 4.0), (0.2, 1.0)])
        [0, 2]
    """
    return pareto_front([(error, -seconds) for error, seconds in points])


def exponent(measurements: Sequence[Measurement]) -> float:
    """Return b of the power law seconds ~ size^b.

    It is fitted to the measurements of at least 0.1 ms, or to the two largest sizes if fewer are that long. NaN if
    there are fewer than two sizes.
    """
    points = sorted((one.place, one.seconds) for one in measurements)
    kept = [point for point in points if point[1] >= SMALL]
    kept = kept if len(kept) > 1 else points[-2:]
    if len({size for size, _ in kept}) < 2:
        return math.nan
    size, seconds = np.log(np.array(kept)).T
    return float(np.polyfit(size, seconds, 1)[0])


def bends_upward(measurements: Sequence[Measurement]) -> bool:
    """Return whether cost grows faster than size, and the growth accelerates.

    That is so if the exponent of the larger half of the sizes exceeds 1 and the exponent of the smaller half by more
    than 0.25. If a counter grows faster than size, such as edges in windows of more and more events, the exponent
    of the counter takes the place of 1.
    """
    points = sorted(
        (one for one in measurements if one.seconds >= SMALL),
        key=lambda one: one.place,
    )
    if len(points) < 3:
        return False
    middle = len(points) // 2
    late, counted = exponent(points[middle:]), _growth(points[middle:])
    return late > max(counted, 1) + BENT and late > exponent(points[: middle + 1]) + BENT


def _growth(points: Sequence[Measurement]) -> float:
    """Return the exponent of the counter that grows fastest with size, from first to last; 0 without counters."""
    first, last = points[0], points[-1]
    ratios = [last.counters[name] / count for name, count in first.counters.items() if count and name in last.counters]
    if not ratios or last.place == first.place:
        return 0.0
    return math.log(max(*ratios, 1)) / math.log(last.place / first.place)
