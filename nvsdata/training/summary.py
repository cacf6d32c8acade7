"""Results of a training, computed from the predictions of the network for test recordings."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from nvsdata import metrics
from nvsdata.metrics import Accuracy
from nvsdata.training.evaluation import Votes

COLUMNS = ("recording", "part_us", "class", "predicted", "right_votes", "votes", "right_windows", "windows")


@dataclass(frozen=True)
class Summary:
    """Results of a classifier. In pairs, the first entry is for single windows and the second for votes.

    Args:
        accuracy: Accuracy over all recordings.
        classes: Accuracy of each class; NaN for a class without recordings.
        counts: Recordings of each class [num_classes].
        calibration: Confidence and accuracy of predictions.
        confusion: Confusion matrix of the votes [num_classes, num_classes].
        by_votes: Accuracy if 1, 2, ... windows vote.
        size: (rounds, windows, recordings).
    """

    accuracy: tuple[Accuracy, Accuracy]
    classes: tuple[list[Accuracy], list[Accuracy]]
    counts: np.ndarray
    calibration: tuple[metrics.Calibration, metrics.Calibration]
    confusion: np.ndarray
    by_votes: list[Accuracy]
    size: tuple[int, int, int]


@dataclass(frozen=True)
class Mistake:
    """Recording that at least one vote misclassified.

    Args:
        index: Index of the recording.
        true: True class.
        named: Predicted class; -1 if scores are NaN.
        confidence: Probability of the predicted class.
        wrong: Fraction of the votes on this recording that are wrong.
    """

    index: int
    true: int
    named: int
    confidence: float
    wrong: float


def summarized(votes: Votes) -> Summary:
    """Summarize a network's votes. The confidence of a vote is that of its mean log-probabilities."""
    voters, targets = votes.voters.numpy(), votes.targets.numpy()
    rounds, windows, recordings, classes = voters.shape
    named, wanted, sure = [], [], []
    for scores in (voters, voters.mean(1)):
        verdicts, confidence = metrics.predictions(scores)
        named.append(verdicts.ravel())
        sure.append(confidence.ravel())
        wanted.append(np.broadcast_to(targets, verdicts.shape).ravel())
    one, all_ = (
        [_accuracy(right[..., targets == label]) for label in range(classes)]
        for right in (votes.right_windows.numpy(), votes.right_votes.numpy())
    )
    first, second = (metrics.calibration(s, n == w) for s, n, w in zip(sure, named, wanted, strict=True))
    return Summary(
        accuracy=(votes.single, votes.together),
        classes=(one, all_),
        counts=np.bincount(targets, minlength=classes),
        calibration=(first, second),
        confusion=metrics.confusion_matrix(named[1], wanted[1], classes),
        by_votes=metrics.accuracy_by_votes(voters, targets),
        size=(rounds, windows, recordings),
    )


def _accuracy(right: np.ndarray) -> Accuracy:
    return metrics.accuracy(right) if right.size else Accuracy(np.nan, np.nan, np.nan)


def mistakes_of(votes: Votes) -> list[Mistake]:
    """Return misclassified recordings, each by its most confident wrong vote, highest confidence first."""
    named, confidence = metrics.predictions(votes.voters.mean(1).numpy())
    targets = votes.targets.numpy()
    wrong = named != targets
    worst = np.where(wrong, confidence, -1.0).argmax(0)
    found = [
        Mistake(i, int(targets[i]), int(named[worst[i], i]), float(confidence[worst[i], i]), float(wrong[:, i].mean()))
        for i in np.flatnonzero(wrong.any(0)).tolist()
    ]
    return sorted(found, key=lambda mistake: -mistake.confidence)


def as_json(
    summary: Summary,
    mistakes: Sequence[Mistake],
    accuracy_by: dict[str, dict[int, Accuracy]],
    samples: Sequence[Any],
    classes: Sequence[str],
) -> dict[str, Any]:
    """Return all results with classes by name; undefined values are None.

    `accuracy_by` maps the name of a quantity to the accuracy for each of its values. `samples` are those of the test
    dataset. An accuracy is [value, low, high], with the 95% interval over recordings.
    """
    rounds, windows, recordings = summary.size
    one, together = (dict(zip(classes, values, strict=True)) for values in summary.classes)
    counts = dict(zip(classes, summary.counts.tolist(), strict=True))
    return {
        "recordings": recordings,
        "windows": windows,
        "rounds": rounds,
        "accuracy": dict(zip(("window", "vote"), map(_numbers, summary.accuracy), strict=True)),
        "classes": {
            name: {"recordings": counts[name], "window": _numbers(one[name]), "vote": _numbers(together[name])}
            for name in classes
        },
        "confusion": {
            true: {classes[named]: int(row[named]) for named in np.flatnonzero(row).tolist()}
            for true, row in zip(classes, summary.confusion, strict=True)
        },
        "calibration": dict(zip(("window", "vote"), map(_bins, summary.calibration), strict=True)),
        "accuracy_by_votes": {str(k): _numbers(found) for k, found in enumerate(summary.by_votes, 1)},
        **{
            f"accuracy_by_{quantity}": {str(value): _numbers(found) for value, found in accuracies.items()}
            for quantity, accuracies in accuracy_by.items()
        },
        "mistakes": [
            {
                "recording": samples[mistake.index].name,
                "part_us": samples[mistake.index].window,
                "true": classes[mistake.true],
                "predicted": None if mistake.named < 0 else classes[mistake.named],
                "confidence": mistake.confidence,
                "wrong_votes": mistake.wrong,
            }
            for mistake in mistakes
        ],
    }


def as_csv(votes: Votes, samples: Sequence[Any], classes: Sequence[str]) -> str:
    """Return a table with a row for each recording, with the numbers of its correct votes and windows.

    `predicted` is the class with most votes, or the first of several such classes. It is empty if all scores are NaN.
    """
    named, _ = metrics.predictions(votes.voters.mean(1).numpy())
    rounds, windows = votes.voters.shape[:2]
    right_votes, right_windows = votes.right_votes.sum(0).tolist(), votes.right_windows.sum((0, 1)).tolist()
    table = io.StringIO()
    writer = csv.writer(table, lineterminator="\n")
    writer.writerow(COLUMNS)
    for i, (sample, label) in enumerate(zip(samples, votes.targets.tolist(), strict=True)):
        known = named[:, i][named[:, i] >= 0]
        predicted = classes[int(np.bincount(known).argmax())] if known.size else ""
        part = "-".join(map(str, sample.window)) if sample.window else ""
        row = right_votes[i], rounds, right_windows[i], rounds * windows
        writer.writerow([sample.name, part, classes[label], predicted, *row])
    return table.getvalue()


def _bins(found: metrics.Calibration) -> dict[str, Any]:
    means = {name: _numbers(getattr(found, name).tolist()) for name in ("confidence", "accuracy")}
    return {"expected_calibration_error": found.error, "count": found.counts.tolist(), **means}


def _numbers(values: Iterable[float]) -> list[float | None]:
    return [None if np.isnan(value) else value for value in values]
