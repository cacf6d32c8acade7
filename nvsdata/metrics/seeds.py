"""Figures of runs that differ in their seed, as text."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping
from statistics import mean, stdev
from typing import Any

from scipy import special


def by_settings(lines: Iterable[Mapping[str, Any]], names: Collection[str]) -> dict[str, dict[str, dict[int, float]]]:
    """Return the results `names` of runs by settings, name and seed, from a line for each run."""
    runs: dict[str, dict[str, dict[int, float]]] = {}
    for line in lines:
        of_these = runs.setdefault(line["settings"], {name: {} for name in names})
        for name in names:
            of_these[name][line["seed"]] = line[name]
    return runs


def spread(values: Collection[float]) -> str:
    """Return mean and standard deviation of values, such as "0.937 ± 0.003": the mean if there is one, "" if none."""
    if not values:
        return ""
    return f"{mean(values):.3f}" + (f" ± {stdev(values):.3f}" if len(values) > 1 else "")


def points_apart(accuracies: Mapping[int, float], others: Mapping[int, float]) -> str:
    """Return the mean difference in points between runs with the same seed, such as "+1.1 (+0.9 to +1.3) *".

    A point is 0.01. The interval is Student's 95% interval over the seeds, and an asterisk marks one without 0. One
    common seed gives no interval, and none gives "".

    Args:
        accuracies: Accuracy of each run, by its seed.
        others: Accuracy of each run with other settings, by its seed.
    """
    points = [100 * (accuracies[seed] - others[seed]) for seed in accuracies if seed in others]
    if len(points) < 2:
        return "".join(f"{one:+.1f}" for one in points)
    middle, half = mean(points), special.stdtrit(len(points) - 1, 0.975) * stdev(points) / math.sqrt(len(points))
    return f"{middle:+.1f} ({middle - half:+.1f} to {middle + half:+.1f})" + (" *" if abs(middle) > half else "")
