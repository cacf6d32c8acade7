"""Pareto fronts and scaling exponents of measurements."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import groupby

import numpy as np

from nvsdata.benchmarks.line import OURS, Line
from nvsdata.plots import pareto_front

SMALL = 1e-4  # s, below which a call's own cost hides how it grows
BENT = 0.25  # by which the exponent of the larger half may exceed 1 and that of the smaller one


def works(lines: Sequence[Line]) -> list[list[Line]]:
    """Lines of the same work together, in their order."""
    ordered = sorted(range(len(lines)), key=lambda i: _first(lines, i))
    return [[lines[i] for i in group] for _, group in groupby(ordered, key=lambda i: (lines[i].task, lines[i].work))]


def _first(lines: Sequence[Line], at: int) -> tuple[int, int]:
    work = lines[at].task, lines[at].work
    return next(i for i, line in enumerate(lines) if (line.task, line.work) == work), at


def is_scaling(lines: Sequence[Line]) -> bool:
    """Return True if the lines of a task are of growing sizes."""
    return any(line.axis in line.size for line in lines)


def is_tradeoff(lines: Sequence[Line]) -> bool:
    """Return True if a setting of the task trades time for accuracy."""
    ours = [line for line in lines if line.library == OURS and line.axis]
    return not is_scaling(lines) and len({line.error for line in ours if line.error is not None}) > 1


def front(points: Sequence[tuple[float, float]]) -> list[int]:
    """Numbers of the points (error, seconds) for which no other has no larger error and takes less time, by error."""
    return pareto_front([(error, -seconds) for error, seconds in points])


def exponent(lines: Sequence[Line]) -> float:
    """Return b of seconds ~ size^b, fit to lines of at least 0.1 ms or to the two largest; NaN for fewer than two."""
    points = sorted((line.place, line.seconds) for line in lines)
    kept = [point for point in points if point[1] >= SMALL]
    kept = kept if len(kept) > 1 else points[-2:]
    if len({size for size, _ in kept}) < 2:
        return math.nan
    size, seconds = np.log(np.array(kept)).T
    return float(np.polyfit(size, seconds, 1)[0])


def bends_upward(lines: Sequence[Line]) -> bool:
    """Return True if cost grows faster than size, and ever faster: the exponent of the larger half is well above both.

    Where what is counted grows faster than size, such as edges in ever busier windows, that takes the place of size.
    """
    points = sorted((line for line in lines if line.seconds >= SMALL), key=lambda line: line.place)
    if len(points) < 3:
        return False
    middle = len(points) // 2
    late, counted = exponent(points[middle:]), _growth(points[middle:])
    return late > max(counted, 1) + BENT and late > exponent(points[: middle + 1]) + BENT


def _growth(points: Sequence[Line]) -> float:
    """By which power of the size what is counted grows, from the first line to the last; 0 if nothing is."""
    first, last = points[0], points[-1]
    ratios = [last.counters[name] / count for name, count in first.counters.items() if count and name in last.counters]
    if not ratios or last.place == first.place:
        return 0.0
    return math.log(max(*ratios, 1)) / math.log(last.place / first.place)
