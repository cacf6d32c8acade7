"""Similarities of two feature vectors (thesis, Table 5.4), and ROC curves of scores (thesis, section 5.3.2)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

COUNT = 12
FLOOR = 1e-10  # smallest argument of a logarithm; smaller values are raised to it
_LARGEST = np.finfo(np.float64).max
_TINY = np.finfo(np.float64).smallest_subnormal
_LEAST = -(1 << 20)  # exponent that stands for the number 0
_USUAL = 2.0**-100, 2.0**100  # squares of differences of numbers in this range fit float64


def similarities(a: npt.ArrayLike, b: npt.ArrayLike) -> np.ndarray:
    """Return the 12 similarities of Table 5.4 of the thesis, in the order of the table.

    Conventions: 0/0 is 0. The arguments of logarithms (no. 10) are at least 1e-10, so that 0 log 0 is 0, and a feature
    that is 0 in only one vector contributes a finite ratio. No. 5 sums absolute differences, and no. 12 divides by the
    product of the two sums.

    Args:
        a: Feature vectors [..., D] without negative numbers, as after a ReLU.
        b: The vectors to compare with them, of the same shape.

    Returns:
        float64 [..., 12]. All results are finite, and correct to 12 digits for features from 1e-300 to 1e300. A
        similarity beyond the range of float64, such as no. 1 of features above 1e154, becomes the largest float64.

    Raises:
        ValueError: If features are negative, infinite or NaN, or if shapes differ.

    Example:
        >>> similarities([1.0, 0.0], [1.0, 0.0])[[0, 6, 8]].tolist()
        [1.0, 1.0, 0.0]
    """
    x, y = np.asarray(a, np.float64), np.asarray(b, np.float64)
    if x.shape != y.shape or x.ndim == 0:
        raise ValueError(f"a and b must be vectors of one shape [..., D], not {x.shape} and {y.shape}")
    for name, values in (("a", x), ("b", y)):
        if not np.isfinite(values).all() or (values < 0).any():
            raise ValueError(f"{name} must contain finite features that are not negative")
    least, most = np.minimum(x, y), np.maximum(x, y)
    apart = most - least
    # all quotients are computed from these two fractions of the larger number, which are at most 1
    whole = np.maximum(most, _TINY)
    share, gap = least / whole, apart / whole
    sums, root_sums = 1 + share, 1 + np.sqrt(share)
    of = _Scaled.usual if _USUAL[0] <= _smallest(x, y) and most.max(initial=1) <= _USUAL[1] else _Scaled.any
    of_x, of_y, of_least, of_apart = of(x), of(y), of(least), of(apart)
    dot = of_x.times(of_y).sum()
    lengths = of_x.times(of_x).sum().root().times(of_y.times(of_y).sum().root())
    columns = (
        dot,
        dot.root(),
        of(np.sqrt(x) * np.sqrt(y)).sum().root(),
        of_least.scaled(1 / sums).sum().root(),
        of_apart.sum(),
        of_apart.scaled(gap / sums).sum().root(),
        dot.divided_by(lengths),
        of_apart.scaled(gap / (root_sums * root_sums)).sum().root(),
        of_apart.times(of_apart).sum().root(),
        of_apart.scaled(_logarithm(least, most) / 2).sum(),
        of((most > 0) / np.sqrt(sums)).sum(),
        of_least.sum().divided_by(of_x.sum().times(of_y.sum())),
    )
    return np.stack([column.value() for column in columns], -1)


class _Scaled(NamedTuple):
    """Non-negative numbers that may exceed the range of float64: `part` * 2 ** `power`.

    Numbers of ordinary size share a single `power` of 0, which costs no time.
    """

    part: np.ndarray
    power: np.ndarray

    @classmethod
    def any(cls, values: np.ndarray) -> _Scaled:
        return cls(*np.frexp(values))

    @classmethod
    def usual(cls, values: np.ndarray) -> _Scaled:
        return cls(values, np.zeros((), np.int32))

    def scaled(self, factor: np.ndarray) -> _Scaled:
        """Multiply by numbers of ordinary size."""
        return _Scaled(self.part * factor, self.power)

    def times(self, other: _Scaled) -> _Scaled:
        return _Scaled(self.part * other.part, self.power + other.power)

    def divided_by(self, other: _Scaled) -> _Scaled:
        return _Scaled(_ratio(self.part, other.part), self.power - other.power)

    def root(self) -> _Scaled:
        odd = self.power & 1
        return _Scaled(np.sqrt(np.ldexp(self.part, odd)), (self.power - odd) // 2)

    def sum(self) -> _Scaled:
        """Return the sum over the last axis."""
        if not self.power.ndim:
            return _Scaled(self.part.sum(-1), self.power)
        power = np.where(self.part > 0, self.power, _LEAST)
        largest = power.max(-1, initial=_LEAST, keepdims=True)
        return _Scaled(np.ldexp(self.part, self.power - largest).sum(-1), largest[..., 0])

    def value(self) -> np.ndarray:
        """Return the numbers as float64; those beyond its range become the largest float64."""
        with np.errstate(over="ignore", under="ignore"):
            return np.asarray(np.minimum(np.ldexp(self.part, self.power), _LARGEST))


def _smallest(*arrays: np.ndarray) -> float:
    """Return the smallest value above 0, but at most 1."""
    return min(float(np.where(values > 0, values, 1).min(initial=1)) for values in arrays)


def _logarithm(least: np.ndarray, most: np.ndarray) -> np.ndarray:
    """Return log(most / least), with both raised to at least FLOOR."""
    low, high = np.maximum(least, FLOOR), np.maximum(most, FLOOR)
    root = np.sqrt(low)
    # log1p of (ratio of roots - 1) is never out of range; a difference of two logarithms would be mostly rounding error
    return np.asarray(2 * np.log1p((high - low) / (np.sqrt(high) + root) / root))


def roc(scores: npt.ArrayLike, same: npt.ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    """Return the ROC curve of scores that say whether two samples are of the same class.

    Args:
        scores: [N]; higher means more likely of the same class. They may be infinite.
        same: [N], 1 for pairs of the same class and 0 for the others.

    Returns:
        False positive rates and true positive rates, each float64 [thresholds]. The first threshold is above the
        highest score, and the others are the scores in descending order, equal ones once.

    Raises:
        ValueError: If a score is NaN, for other shapes or values, and if one of the two kinds of pairs is missing.

    Example:
        >>> [rates.tolist() for rates in roc([0.9, 0.1], [1, 0])]
        [[0.0, 0.0, 1.0], [0.0, 1.0, 1.0]]
    """
    values, given = np.asarray(scores, np.float64), np.asarray(same)
    if values.ndim != 1 or values.shape != given.shape:
        raise ValueError(f"scores and same must be of one shape [N], not {values.shape} and {given.shape}")
    if np.isnan(values).any():
        raise ValueError(f"{np.isnan(values).sum()} of {values.size} scores are NaN")
    truth = given == 1
    if not (truth | (given == 0)).all():
        raise ValueError("same must contain only 1 and 0")
    if truth.all() or not truth.any():
        raise ValueError("pairs that are the same and pairs that differ are both needed")
    order = np.argsort(-values, kind="stable")
    ranked = values[order]
    ends = np.append(np.flatnonzero(ranked[1:] != ranked[:-1]), values.size - 1)
    hits, alarms = np.cumsum(truth[order])[ends], np.cumsum(~truth[order])[ends]
    return np.append(0.0, alarms / (~truth).sum()), np.append(0.0, hits / truth.sum())


def area_under_roc(scores: npt.ArrayLike, same: npt.ArrayLike) -> float:
    """Return the area under the curve of `roc`.

    It is the probability that a pair of the same class has a higher score than a pair of different classes.

    Args:
        scores: [N]; higher means more likely of the same class. They may be infinite.
        same: [N], 1 for pairs of the same class and 0 for the others.

    Raises:
        ValueError: If a score is NaN, for other shapes or values, and if one of the two kinds of pairs is missing.

    Example:
        >>> area_under_roc([0.9, 0.8, 0.1], [1, 0, 0])
        1.0
    """
    return float(np.trapezoid(*roc(scores, same)[::-1]))


def _ratio(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return a / b, and 0 where b is 0 (a is 0 there, too)."""
    return np.asarray(np.divide(a, b, out=np.zeros(np.broadcast(a, b).shape), where=b > 0))
