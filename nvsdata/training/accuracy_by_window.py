"""Accuracy of a trained network as a function of the length of its windows, and of the number of their events."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from statistics import median
from typing import Any, ClassVar

import numpy as np
from torch.utils.data import ConcatDataset

from nvsdata import transforms as T
from nvsdata.data.events import Events
from nvsdata.datasets import SeededDataset
from nvsdata.metrics.intervals import Accuracy, accuracy
from nvsdata.training.data import loader
from nvsdata.training.evaluation import correct, predict
from nvsdata.training.trainer import Trainer
from nvsdata.transforms.events.windows import after_window

FACTORS = (0.25, 0.5, 1.0, 2.0, 4.0)  # window lengths, as multiples of the length in training
WINDOWS = 1_000  # maximum number of windows of each length, so that reports on large datasets are fast
MOST_DRAWS = 5  # maximum number of windows per recording, if there are fewer recordings than WINDOWS
MEASURED = 8  # number of recordings whose durations are compared
FRACTIONS = (1 / 16, 1 / 8, 1 / 4, 1 / 2, 1)  # numbers of events, as fractions of the median number in a window
COUNTED = 100  # maximum number of recordings whose windows' events are counted


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
    return _accuracies(trainer, test, {length: T.with_window_length(transform, length) for length in lengths})


def accuracy_by_events(trainer: Trainer, test: Callable[[Any], Any], transform: Any) -> dict[int, Accuracy]:
    """Measure the accuracy of single windows as a function of the number of events that are used.

    Windows have the length of the transform, and are cut after that number of events. The numbers are a sixteenth to
    one times the median number of events in such windows. About 1,000 windows are used per number, from recordings
    spread over the dataset, the same at every call.

    Args:
        trainer: Trainer whose network, seed, batch and processes are used.
        test: Function from a transform to the test dataset.
        transform: Transform from a recording to the network's input.

    Returns:
        Accuracy by the number of events; empty for a transform that cuts no windows.
    """
    if T.window_length(transform) is None:
        return {}
    # seeded, because all processes must use the same numbers
    windows = SeededDataset(_spread(test(after_window(transform, _Counted(), last=True)), COUNTED), trainer.seed)
    usual = median(np.concatenate([np.atleast_1d(windows[0, i][0]) for i in range(len(windows))]).tolist())
    counts = sorted({max(1, round(usual * fraction)) for fraction in FRACTIONS})
    return _accuracies(trainer, test, {count: after_window(transform, _Earliest(count)) for count in counts})


@dataclass(frozen=True)
class _Counted:
    """Return the number of events."""

    deterministic: ClassVar[bool] = True

    def __call__(self, events: Events) -> int:
        return len(events)


@dataclass(frozen=True)
class _Earliest:
    """Cut a window after its first `count` events."""

    count: int
    deterministic: ClassVar[bool] = True

    def __call__(self, events: Events) -> Events:
        if len(events) <= self.count:
            return events
        return events[: self.count].window(events.start, int(events.t[self.count - 1]) + 1)


def _accuracies(trainer: Trainer, test: Callable[[Any], Any], transforms: dict[int, Any]) -> dict[int, Accuracy]:
    """Return the accuracy on about WINDOWS windows for each transform."""
    parts = [_spread(test(transform), WINDOWS) for transform in transforms.values()]
    draws = min(MOST_DRAWS, -(-WINDOWS // len(parts[0])))
    how: dict[str, Any] = {"seed": trainer.seed, "last": draws, "whole_batches": True}
    batches = loader(ConcatDataset(parts), trainer.batch, trainer.team, **how)
    scores, targets = predict(trainer.model, batches, trainer.team)
    right = correct(scores, targets).view(draws, len(parts), -1)
    return {which: accuracy(right[:, i].numpy()) for i, which in enumerate(transforms)}


def _spread(dataset: Any, most: int) -> Any:
    """Return at most `most` of a dataset's samples, evenly spread over it."""
    count = min(most, len(dataset))
    return dataset.subset(i * len(dataset) // count for i in range(count))
