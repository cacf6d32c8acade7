"""Accuracy of a classifier: by class, by number of votes, by confidence."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from nvsdata.metrics.intervals import Accuracy, wilson_interval

BINS = 15  # number of bins of equal width, as in Guo et al. 2017
ORDERS = 20  # smallest number of orders of voters that are averaged
NONE = -1  # class of samples whose scores are NaN


class Calibration(NamedTuple):
    """Confidence and accuracy of predictions, in bins of equal width by confidence.

    Args:
        counts: Number of predictions in each bin, int64 [bins].
        confidence: Mean confidence in each bin, float64 [bins]; NaN if the bin is empty.
        accuracy: Accuracy in each bin, float64 [bins]; NaN if the bin is empty.
        error: Expected calibration error: the mean of |accuracy - confidence| over bins, weighted by `counts`.

    Example:
        >>> calibration([0.9, 0.9], [1, 1], bins=2).counts.tolist()
        [0, 2]
    """

    counts: np.ndarray
    confidence: np.ndarray
    accuracy: np.ndarray
    error: float


def predictions(scores: npt.ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    """Return the most probable class and its probability.

    Args:
        scores: Logits or log-probabilities [..., classes].

    Returns:
        int64 [...] and float64 [...]; -1 and 0 where a score is NaN or infinite.

    Example:
        >>> predicted, confidence = predictions([[0.0, 0.0, 9.0]])
        >>> predicted.tolist(), confidence.round(3).tolist()
        ([2], [1.0])
    """
    given = np.asarray(scores, np.float64)
    named = given.argmax(-1)
    highest = np.take_along_axis(given, named[..., None], -1)
    with np.errstate(invalid="ignore"):
        confidence = 1 / np.exp(given - highest).sum(-1)
    unknown = np.isnan(confidence)
    return np.where(unknown, NONE, named), np.where(unknown, 0.0, confidence)


def confusion_matrix(predicted: npt.ArrayLike, targets: npt.ArrayLike, classes: int) -> np.ndarray:
    """Count the samples of each true class (row) and predicted class (column).

    Args:
        predicted: Predicted classes, int [N]. Samples with -1 are left out.
        targets: True classes, int [N].
        classes: Number of classes.

    Returns:
        int64 [classes, classes].

    Raises:
        ValueError: If the shapes differ, or a class is out of range.

    Example:
        >>> confusion_matrix([0, 1, 1], [0, 0, 1], 2).tolist()
        [[1, 1], [0, 1]]
    """
    named, wanted = _classes_of(predicted, targets, classes)
    known = named != NONE
    pairs: np.ndarray = np.bincount(wanted[known] * classes + named[known], minlength=classes * classes)
    return pairs.reshape(classes, classes).astype(np.int64)


def class_accuracies(predicted: npt.ArrayLike, targets: npt.ArrayLike, classes: int) -> np.ndarray:
    """Return the fraction of each class's samples that are predicted correctly.

    Args:
        predicted: Predicted classes, int [N]. -1 counts as wrong.
        targets: True classes, int [N].
        classes: Number of classes.

    Returns:
        float64 [classes]; NaN for a class without samples.

    Raises:
        ValueError: If the shapes differ, or a class is out of range.

    Example:
        >>> class_accuracies([0, 1, 1], [0, 0, 1], 2).tolist()
        [0.5, 1.0]
    """
    named, wanted = _classes_of(predicted, targets, classes)
    count = np.bincount(wanted, minlength=classes)
    right = np.bincount(wanted[named == wanted], minlength=classes)
    return _quotient(right, count)


def calibration(confidence: npt.ArrayLike, right: npt.ArrayLike, bins: int = BINS) -> Calibration:
    """Compare confidence with accuracy, by the expected calibration error (Guo et al. 2017, eq. 3).

    Args:
        confidence: Probability of the predicted class, [N], from 0 to 1.
        right: 1 (True) for each correct prediction, [N].
        bins: Number of bins of equal width (default 15). A bin contains its upper bound; the first one contains 0, too.

    Returns:
        A `Calibration`.

    Raises:
        ValueError: If there are no samples, if shapes differ, if a confidence is out of range, or for less than one
            bin.

    Example:
        >>> round(calibration([0.9, 0.9, 0.6], [1, 1, 0]).error, 3)
        0.267
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


def accuracy_by_votes(voters: npt.ArrayLike, targets: npt.ArrayLike, level: float = 0.95) -> list[Accuracy]:
    """Return the accuracy if 1, 2, ... of the windows of a recording vote.

    A vote of k windows sums the log-probabilities of the first k windows in some order. The result is the mean over
    rounds and over at least 20 orders. Each window comes first in equally many orders, so the results for one window
    and for all windows are exact.

    Args:
        voters: Log-probabilities [rounds, windows, N, classes]; in each round, `windows` windows are cut from each of N
            recordings.
        targets: True classes [N].
        level: Confidence level, the fraction of intervals that contain the true accuracy (default 0.95).

    Returns:
        An `Accuracy` for each number of windows.

    Raises:
        ValueError: If the shapes don't fit, or if `level` isn't between 0 and 1.

    Example:
        >>> [found.value for found in accuracy_by_votes([[[[-0.1, -2.4]], [[-1.2, -0.4]]]], [0])]
        [0.5, 1.0]
    """
    given, wanted = np.asarray(voters), np.asarray(targets)
    if given.ndim != 4 or not all(given.shape) or wanted.shape != given.shape[2:3]:
        raise ValueError(
            f"voters must be [rounds, windows, N, classes] and targets [N], not {given.shape}, {wanted.shape}"
        )
    windows = given.shape[1]
    orders = _orders(windows)
    right = np.zeros((windows, len(orders), *given[:, 0, :, 0].shape), bool)
    for n, order in enumerate(orders):
        total = np.zeros_like(given[:, 0])
        for k, window in enumerate(order):
            total += given[:, window]
            right[k, n] = (total.argmax(-1) == wanted) & ~np.isnan(total).any(-1)
    means = right.mean((1, 2))
    # `windows // k` votes of k windows have no window in common
    return [wilson_interval(means[k - 1], len(given) * (windows // k), level) for k in range(1, windows + 1)]


def _orders(windows: int) -> list[np.ndarray]:
    """Return all rotations of some random orders, the same ones at every call."""
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
