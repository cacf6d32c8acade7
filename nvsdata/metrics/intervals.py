"""Accuracy of a classifier with its confidence interval, and a paired test of two classifiers."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy import special


class Accuracy(NamedTuple):
    """Accuracy on a sample of recordings, with a confidence interval.

    Args:
        value: Fraction of correct predictions; NaN without predictions.
        low: Lower end of the interval.
        high: Upper end of the interval.

    Example:
        >>> f"{accuracy([1] * 196 + [0] * 3):.3f}"
        '0.985 (0.957 to 0.995)'
    """

    value: float
    low: float
    high: float

    def __format__(self, form: str) -> str:
        value, low, high = (format(number, form) for number in self)
        return f"{value} ({low} to {high})"


class PairedTest(NamedTuple):
    """Difference of two classifiers on the same recordings.

    Args:
        difference: Accuracy of the first minus that of the second.
        interval: Confidence interval of the difference, (low, high).
        p: Probability of a difference at least this large if the classifiers were equally good.

    Example:
        >>> paired_test([1, 1, 1, 0], [1, 1, 0, 0]).difference
        0.25
    """

    difference: float
    interval: tuple[float, float]
    p: float


def accuracy(right: npt.ArrayLike, level: float = 0.95) -> Accuracy:
    """Return an accuracy with Wilson's (1927) confidence interval, over recordings.

    Windows of one recording are correlated. With several predictions per recording, the interval therefore
    uses an effective sample size: the number of independent predictions that would make the accuracy as uncertain as
    the spread between recordings shows (Kish 1965, section 8.2). It is between the numbers of recordings and of
    predictions.

    Args:
        right: 1 (True) for each correct prediction, [N] or [..., N] for several predictions of each of N recordings.
        level: Confidence level, the fraction of intervals that contain the true accuracy (default 0.95).

    Returns:
        An `Accuracy`.

    Raises:
        ValueError: If there are no predictions, if they aren't 0 or 1, or if `level` isn't between 0 and 1.

    Example:
        >>> f"{accuracy([1, 1, 1, 0]):.2f}"
        '0.75 (0.30 to 0.95)'
    """
    given = _outcomes(right)
    return wilson_interval(given.mean(0), len(given), level)


def wilson_interval(values: np.ndarray, independent: int, level: float) -> Accuracy:
    """Return the accuracy with Wilson's interval for recordings with several predictions each.

    Args:
        values: Fraction of each recording's predictions that are correct, [N].
        independent: Largest number of predictions of a recording that can be independent.
        level: Confidence level, the fraction of intervals that contain the true accuracy.
    """
    z = _quantile(level)
    mean = values.mean()
    variance = mean * (1 - mean)
    ratio = values.var() / variance if variance > 0 else 1.0
    count = values.size / min(max(ratio, 1 / independent), 1.0)
    center = (mean + z * z / (2 * count)) / (1 + z * z / count)
    half = z / (1 + z * z / count) * np.sqrt(variance / count + (z / (2 * count)) ** 2)
    # with all predictions right, or all wrong, one end is the accuracy itself, except for rounding errors
    return Accuracy(float(mean), float(center - half) if mean > 0 else 0.0, float(center + half) if mean < 1 else 1.0)


def paired_test(first: npt.ArrayLike, second: npt.ArrayLike, level: float = 0.95) -> PairedTest:
    """Test whether two classifiers differ in accuracy, by their predictions for the same recordings.

    The test is exact: it counts in how many of all exchanges of the two classifiers' results, recording by recording,
    the difference is at least as large. With one prediction per recording it is McNemar's exact test. The interval is
    that of Bonett and Price (2012): Wald's interval with one recording added in favor of each classifier. With several
    predictions per recording, an added recording has the root mean square of the differences that aren't 0.

    Args:
        first: 1 (True) for each correct prediction, [N] or [..., N] for several predictions of each of N recordings.
        second: The same for the other classifier, with the same shape.
        level: Confidence level, the fraction of intervals that contain the true difference (default 0.95).

    Returns:
        A `PairedTest`.

    Raises:
        ValueError: If the shapes differ, if there are no predictions, if they aren't 0 or 1, or if `level` isn't
            between 0 and 1.

    Example:
        >>> found = paired_test([1] * 90 + [0] * 10, [1] * 80 + [0] * 20)
        >>> round(found.difference, 3), round(found.p, 3)
        (0.1, 0.002)
    """
    ours, theirs, z = _outcomes(first), _outcomes(second), _quantile(level)
    if ours.shape != theirs.shape:
        raise ValueError(f"first and second must have one shape, not {np.shape(first)} and {np.shape(second)}")
    gains = ours.sum(0) - theirs.sum(0)
    differences = gains / len(ours)
    squares, unequal, count = (differences**2).sum(), np.count_nonzero(differences), differences.size + 2
    added = squares / unequal if unequal else 1.0
    mean = differences.sum() / count
    half = z * np.sqrt(max((squares + 2 * added) / count - mean**2, 0.0) / count)
    low, high = max(mean - half, -1.0), min(mean + half, 1.0)
    return PairedTest(float(differences.mean()), (float(low), float(high)), _exchanges(gains))


def _exchanges(gains: np.ndarray) -> float:
    """Return the fraction of all choices of signs for which |sum of gains| is at least that of the given signs."""
    sizes = np.abs(gains[gains != 0])
    chances = np.ones(1)
    # distribution of the sum, in steps of 2 from -sizes.sum() on
    for size, times in zip(*np.unique(sizes, return_counts=True), strict=True):
        of_size = np.zeros(size * times + 1)
        k = np.arange(times + 1)
        of_size[::size] = np.exp(-special.betaln(k + 1, times - k + 1) - np.log(times + 1) - times * np.log(2))
        chances = np.convolve(chances, of_size)
    sums = 2 * np.arange(chances.size) - sizes.sum()
    return float(min(chances[np.abs(sums) >= abs(gains.sum())].sum(), 1.0))


def _outcomes(right: npt.ArrayLike) -> np.ndarray:
    """Return predictions as int64 [predictions per recording, N].

    ValueError for an empty array, and for values other than 0 (wrong) and 1 (right).
    """
    given = np.asarray(right)
    if not given.size or not given.ndim:
        raise ValueError(f"there must be predictions [N] or [..., N], not {given.shape}")
    if not ((given == 0) | (given == 1)).all():
        raise ValueError("predictions must be 0 or 1, for wrong or right")
    return given.reshape(-1, given.shape[-1]).astype(np.int64)


def _quantile(level: float) -> float:
    if not 0 < level < 1:
        raise ValueError(f"level must be between 0 and 1, not {level}")
    return float(special.ndtri((1 + level) / 2))
