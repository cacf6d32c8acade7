"""How often a classifier is right: of each class, by the number of votes, and by how sure it is."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

BINS = 15  # of equal width, as Guo et al. 2017 have them
ORDERS = 20  # at least so many orders of voters are averaged
NONE = -1  # in place of a class where scores are NaN


class Calibration(NamedTuple):
    """Confidence and accuracy of predictions, in bins of equal width by confidence.

    - `counts`: predictions in each bin, int64 [bins]
    - `confidence`, `accuracy`: their means in each bin, float64 [bins], NaN where it is empty
    - `error`: the expected calibration error, mean of |accuracy - confidence| over all predictions' bins
    """

    counts: np.ndarray
    confidence: np.ndarray
    accuracy: np.ndarray
    error: float


def verdicts(scores: npt.ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    """The most probable class and its probability.

    - `scores`: logits or log-probabilities [..., classes]

    Returns int64 [...] and float64 [...]; `NONE` (-1) and 0 where a score is NaN or infinite.
    """
    given = np.asarray(scores, np.float64)
    named = given.argmax(-1)
    highest = np.take_along_axis(given, named[..., None], -1)
    with np.errstate(invalid="ignore"):
        confidence = 1 / np.exp(given - highest).sum(-1)
    unknown = np.isnan(confidence)
    return np.where(unknown, NONE, named), np.where(unknown, 0.0, confidence)


def confusion_matrix(predicted: npt.ArrayLike, targets: npt.ArrayLike, classes: int) -> np.ndarray:
    """How often each class (row) was taken for each class (column), int64 [classes, classes].

    - `predicted`: classes [N]; `NONE` (-1) counts nowhere
    - `targets`: true classes [N]

    ValueError for different shapes and classes that there aren't.
    """
    named, wanted = _classes_of(predicted, targets, classes)
    known = named != NONE
    pairs: np.ndarray = np.bincount(wanted[known] * classes + named[known], minlength=classes * classes)
    return pairs.reshape(classes, classes).astype(np.int64)


def class_accuracies(predicted: npt.ArrayLike, targets: npt.ArrayLike, classes: int) -> np.ndarray:
    """Share of each class's samples that are recognized, float64 [classes], NaN for a class without samples.

    Parameters and errors as for `confusion_matrix`; `NONE` is wrong.
    """
    named, wanted = _classes_of(predicted, targets, classes)
    count = np.bincount(wanted, minlength=classes)
    right = np.bincount(wanted[named == wanted], minlength=classes)
    return _quotient(right, count)


def calibration(confidence: npt.ArrayLike, right: npt.ArrayLike, bins: int = BINS) -> Calibration:
    """How well confidence tells accuracy, with the expected calibration error (Guo et al. 2017, eq. 3).

    - `confidence`: probability of the predicted class [N], 0 to 1
    - `right`: whether it was the true one [N]
    - `bins`: of equal width, each with its upper bound (default 15); 0 belongs to the first

    ValueError without samples, for different shapes, for a confidence out of range and for less than one bin.
    """
    sure, hit = np.asarray(confidence, np.float64), np.asarray(right, np.float64)
    if sure.ndim != 1 or sure.shape != hit.shape or not sure.size:
        raise ValueError(f"confidence and right must be [N] with N > 0, not {sure.shape} and {hit.shape}")
    if not ((sure >= 0) & (sure <= 1)).all():
        raise ValueError(f"confidence must be from 0 to 1, not {sure.min()} to {sure.max()}")
    if bins < 1:
        raise ValueError(f"bins must be at least 1, not {bins}")
    bounds = np.arange(1, bins + 1) / bins
    at = np.searchsorted(bounds, sure)
    count = np.bincount(at, minlength=bins)
    sums = [np.bincount(at, values, minlength=bins) for values in (sure, hit)]
    error = float(np.abs(sums[1] - sums[0]).sum() / sure.size)
    means = [_quotient(total, count) for total in sums]
    return Calibration(count, means[0], means[1], error)


def accuracy_by_votes(voters: npt.ArrayLike, targets: npt.ArrayLike) -> np.ndarray:
    """Accuracy if 1, 2, ... of the windows of a recording vote, float64 [windows].

    - `voters`: log-probabilities [rounds, windows, N, classes], which a vote adds up
    - `targets`: true classes [N]

    The mean over rounds and over at least 20 orders of the windows, of which the first ones vote. In these orders each
    window comes first as often as any other: for one window, as for all, the result is exact.
    """
    given, wanted = np.asarray(voters), np.asarray(targets)
    if given.ndim != 4 or not all(given.shape) or wanted.shape != given.shape[2:3]:
        raise ValueError(
            f"voters must be [rounds, windows, N, classes] and targets [N], not {given.shape}, {wanted.shape}"
        )
    windows = given.shape[1]
    orders = _orders(windows)
    right = np.zeros(windows)
    for order in orders:
        total = np.zeros_like(given[:, 0])
        for k, window in enumerate(order):
            total += given[:, window]
            right[k] += ((total.argmax(-1) == wanted) & ~np.isnan(total).any(-1)).mean()
    return right / len(orders)


def _orders(windows: int) -> list[np.ndarray]:
    """All rotations of some random orders, the same at every call."""
    rng = np.random.default_rng(0)
    drawn = [rng.permutation(windows) for _ in range(-(-ORDERS // windows))]
    return [np.roll(order, shift) for order in drawn for shift in range(windows)]


def _quotient(total: np.ndarray, count: np.ndarray) -> np.ndarray:
    return np.asarray(np.divide(total, count, out=np.full(count.shape, np.nan), where=count > 0))


def _classes_of(predicted: npt.ArrayLike, targets: npt.ArrayLike, classes: int) -> tuple[np.ndarray, np.ndarray]:
    named, wanted = np.asarray(predicted, np.int64), np.asarray(targets, np.int64)
    if named.ndim != 1 or named.shape != wanted.shape:
        raise ValueError(f"predicted and targets must be [N], not {named.shape} and {wanted.shape}")
    for name, values, least in (("predicted", named, NONE), ("targets", wanted, 0)):
        if values.size and not (least <= values.min() and values.max() < classes):
            raise ValueError(f"{name} must be from {least} to {classes - 1}, not {values.min()} to {values.max()}")
    return named, wanted
