"""Accuracy of a trained network as a function of the length of its windows."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

from torch.utils.data import ConcatDataset

from nvsdata import transforms as T
from nvsdata.metrics.intervals import Accuracy, accuracy
from nvsdata.training.data import loader
from nvsdata.training.evaluation import correct, predict
from nvsdata.training.trainer import Trainer

FACTORS = (0.25, 0.5, 1.0, 2.0, 4.0)  # window lengths, as multiples of the length in training
WINDOWS = 1_000  # maximum number of windows of each length, so that reports on large datasets are fast
MOST_DRAWS = 5  # maximum number of windows per recording, if there are fewer recordings than WINDOWS
MEASURED = 8  # number of recordings whose durations are compared


def accuracy_by_length(trainer: Trainer, test: Callable[[Any], Any], transform: Any) -> dict[int, Accuracy]:
    """Measure the accuracy of single windows as a function of their length.

    The lengths are a quarter to four times the window length of the transform. Lengths for which recordings are too
    short are replaced by the longest possible length, or by that of the transform. About 1,000 windows are used per
    length, from recordings spread over the dataset, the same at every call.

    Args:
        trainer: Trainer whose network, seed, batch and processes are used.
        test: Function from a transform to the test dataset.
        transform: Transform from a recording to the network's input.

    Returns:
        Accuracy by length in µs; empty for a transform that cuts no windows.
    """
    own = T.window_length(transform)
    if own is None:
        return {}
    measured = _spread(test(partial(T.longest_window, transform)), MEASURED)
    longest = max(own, *(measured[i][0] for i in range(len(measured))))
    lengths = sorted({max(1, min(round(own * factor), longest)) for factor in FACTORS})
    parts = [_spread(test(T.with_window_length(transform, length)), WINDOWS) for length in lengths]
    draws = min(MOST_DRAWS, -(-WINDOWS // len(parts[0])))
    batches = loader(ConcatDataset(parts), trainer.batch, trainer.team, seed=trainer.seed, last=draws)
    scores, targets = predict(trainer.model, batches, trainer.team)
    by_length = scores.view(draws, len(lengths), -1, scores.shape[1])
    wanted = targets.view(draws, len(lengths), -1)
    return {length: accuracy(correct(by_length[:, i], wanted[:, i]).numpy()) for i, length in enumerate(lengths)}


def _spread(dataset: Any, most: int) -> Any:
    """Return at most `most` of a dataset's samples, evenly spread over it."""
    count = min(most, len(dataset))
    return dataset.subset(i * len(dataset) // count for i in range(count))
