"""Accuracy of a network on recordings, by single windows and by voting over windows."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from statistics import median
from typing import Any

import torch
from torch import nn
from torch.utils.data import DataLoader

from nvsdata.data.batching import collate
from nvsdata.datasets import SeededBatches
from nvsdata.metrics.intervals import Accuracy, accuracy
from nvsdata.models.operations import complexity
from nvsdata.models.prediction import vote
from nvsdata.training.data import loader
from nvsdata.training.processes import Team
from nvsdata.training.trainer import VALIDATION, Trainer

TIMED = 100  # maximum number of windows whose prediction is timed
COUNTED = 20  # maximum number of windows whose operations are counted


Outputs = tuple[torch.Tensor, torch.Tensor]


@torch.no_grad()
def predict_batches(model: Callable[[Any], torch.Tensor], batches: DataLoader[Any], team: Team) -> Iterator[Outputs]:
    """Compute a model's outputs, such as scores or features, and yield those of each batch as soon as they are known.

    All processes yield the outputs of all batches, in the order of a single process. Values on a CPU are bit-identical
    for any number of processes: the batches are those of a single process, a sample depends only on seed, epoch and
    index, networks in evaluation mode compute each batch alone, and torch uses one thread, because rounding depends on
    the number of threads.

    Args:
        model: Network or function that returns values [B, ...] of a batch. A network is set to evaluation mode.
        batches: Loader of `(inputs, targets)`, by `loader(..., whole_batches=True)`.
        team: The processes that share the batches. All of them must take all outputs.

    Yields:
        Values [B, ...] and targets [B] on the CPU.

    Raises:
        ValueError: The processes divide each batch.
        ProcessFailed: Another process failed, for example at a damaged recording. That process raises its own error.

    Example:
        >>> import torch
        >>> from nvsdata import training
        >>> team = training.Team(torch.device("cpu"))
        >>> batches = training.loader([(torch.ones(2), 0), (torch.zeros(2), 1)], 1, team, whole_batches=True)
        >>> [values.tolist() for values, targets in training.predict_batches(torch.nn.Identity(), batches, team)]
        [[[1.0, 1.0]], [[0.0, 0.0]]]
    """
    sampler = getattr(batches, "batch_sampler", None)
    if isinstance(sampler, SeededBatches) and sampler.count > 1:
        # some processes may have no part of an epoch's last batch, and the order would be lost
        raise ValueError("the processes divide each batch: pass whole_batches=True to the loader")
    if isinstance(model, nn.Module):
        model.eval()
    mine = _outputs(model, batches, team.device)
    # after each batch, because a process must not wait for the end to learn that another one has failed
    while any(parts := team.attempt(lambda: next(mine, None))):
        # in order of rank; some processes may have no part of the last batches
        yield from (part for part in parts if part is not None)


def _outputs(model: Callable[[Any], torch.Tensor], batches: DataLoader[Any], device: torch.device) -> Iterator[Outputs]:
    """Yield the outputs and targets of this process's batches."""
    for inputs, targets in batches:
        with _one_thread(device):
            values = model(inputs.to(device)).cpu()
        yield values, targets


def predict(model: Callable[[Any], torch.Tensor], batches: DataLoader[Any], team: Team) -> Outputs:
    """Compute a model's outputs for all batches in order; see `predict_batches`.

    Args:
        model: Network or function that returns values [B, ...] of a batch.
        batches: Loader of `(inputs, targets)`, by `loader(..., whole_batches=True)`.
        team: The processes that share the batches.

    Returns:
        Values [N, ...] and targets [N], the same in all processes.

    Raises:
        ValueError: The dataset is empty, or the processes divide each batch.
        ProcessFailed: Another process failed.

    Example:
        >>> import torch
        >>> from nvsdata import training
        >>> batches = [(torch.tensor([[2.0, 0.0], [1.0, 0.0]]), torch.tensor([0, 1]))]
        >>> team = training.Team(torch.device("cpu"))
        >>> values, targets = training.predict(torch.nn.Identity(), batches, team)
        >>> values.shape, targets.tolist()
        (torch.Size([2, 2]), [0, 1])
    """
    pairs = list(predict_batches(model, batches, team))
    if not pairs:
        raise ValueError("the dataset is empty, so there is nothing to predict")
    return torch.cat([values for values, _ in pairs]), torch.cat([targets for _, targets in pairs])


@contextmanager
def _one_thread(device: torch.device | str = "cpu") -> Iterator[None]:
    """Let torch compute by one thread while the block runs, unless on a GPU."""
    threads = torch.get_num_threads()
    if torch.device(device).type == "cpu":
        torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(threads)


def correct(scores: torch.Tensor, targets: torch.Tensor) -> torch.Tensor:
    """Return True where scores [..., num_classes] are highest for the true class: bool [...]."""
    # NaN predicts no class, although argmax returns one
    return (scores.argmax(-1) == targets) & ~scores.isnan().any(-1)


@dataclass(frozen=True)
class Votes:
    """Predictions of a network for windows of recordings.

    Args:
        voters: Log-probabilities [rounds, windows, N, num_classes]. The windows of a round vote together; see `vote`.
        targets: True classes [N].

    Example:
        >>> import torch
        >>> from nvsdata import training
        >>> training.Votes(torch.tensor([[[[-0.1, -2.3]], [[-0.7, -0.6]]]]), torch.tensor([0])).single.value
        0.5
    """

    voters: torch.Tensor
    targets: torch.Tensor

    @cached_property
    def right_windows(self) -> torch.Tensor:
        """True for each window that is classified correctly, bool [rounds, windows, N]."""
        return correct(self.voters, self.targets)

    @cached_property
    def right_votes(self) -> torch.Tensor:
        """True for each correct vote, bool [rounds, N]."""
        return correct(vote(self.voters, 1), self.targets)

    @property
    def single(self) -> Accuracy:
        """Accuracy of single windows, averaged over all windows."""
        return accuracy(self.right_windows.numpy())

    @property
    def together(self) -> Accuracy:
        """Accuracy of the votes, averaged over all rounds."""
        return accuracy(self.right_votes.numpy())

    def __str__(self) -> str:
        """Return both accuracies in one line."""
        _, windows, recordings = self.right_windows.shape
        kinds = f"single windows {self.single:.3f}, votes of {windows} {self.together:.3f}"
        return f"accuracy on {recordings} recordings, with 95% intervals: {kinds}"


def votes(
    model: Callable[[Any], torch.Tensor], batches: DataLoader[Any], windows: int, team: Team, rounds: int = 1
) -> Votes:
    """Compute a model's predictions for each window of each recording.

    Args:
        model: Network or function that returns scores [B, num_classes].
        batches: Loader of `rounds` x `windows` epochs, each with every recording once in the same order, by
            `loader(..., whole_batches=True)`.
        windows: Number of windows that vote together.
        team: The processes that share the batches.
        rounds: Votes per recording (default 1).

    Returns:
        A `Votes`.

    Example:
        >>> import torch
        >>> from nvsdata import training
        >>> batches = [(torch.tensor([[2.0, 0.0], [1.0, 0.0]]), torch.tensor([0, 1]))]
        >>> team = training.Team(torch.device("cpu"))
        >>> training.votes(torch.nn.Identity(), batches, 1, team).targets.tolist()
        [0, 1]
    """
    scores, targets = predict(model, batches, team)
    voters = scores.log_softmax(1).view(rounds, windows, -1, scores.shape[1])
    return Votes(voters, targets.chunk(rounds * windows)[0])


@torch.no_grad()
def window_ms(model: nn.Module, dataset: Any, device: torch.device | str = "cpu") -> float:
    """Measure the CPU time of a prediction on one core, from a recording to the scores of a window.

    Args:
        model: The network.
        dataset: Dataset of `(input, target)`, whose samples are read and transformed again.
        device: Device of the network (default "cpu"). On a GPU, only the time of the CPU counts.

    Returns:
        Milliseconds, the median of up to 100 recordings that are spread over the dataset. Waiting for a disk doesn't
        count.

    Raises:
        ValueError: The dataset is empty.

    Example:
        >>> import torch
        >>> from nvsdata import training
        >>> dataset = [(torch.zeros(3), 0), (torch.ones(3), 1)]
        >>> training.window_ms(torch.nn.Linear(3, 2), dataset) < 1_000
        True
    """
    chosen = _spread(dataset, TIMED)
    model.eval()
    with _one_thread():
        times = [_seconds_of(model, dataset, index, device) for index in chosen]
    return 1e3 * median(times)


def cost(model: nn.Module, dataset: Any, device: torch.device | str = "cpu") -> dict[str, int]:
    """Count the weights of a network, and the operations of a prediction.

    Args:
        model: The network.
        dataset: Dataset of `(input, target)`, whose samples are read and transformed again.
        device: Device of the network (default "cpu").

    Returns:
        "weights", and "operations": those that are executed (a multiply-add counts as 2; see `models.complexity`), the
        median of up to 20 recordings that are spread over the dataset.

    Raises:
        ValueError: The dataset is empty.

    Example:
        >>> import torch
        >>> from nvsdata import training
        >>> training.cost(torch.nn.Linear(3, 2), [(torch.zeros(3), 0)])
        {'weights': 8, 'operations': 12}
    """
    found = []
    for index in _spread(dataset, COUNTED):
        batch, _ = collate([dataset[index]])
        found.append(complexity(model, batch.to(device)))
    return {"weights": found[0].weights, "operations": int(median(one.executed for one in found))}


def _spread(dataset: Any, most: int) -> list[int]:
    """Return up to `most` indices that are spread over a dataset. ValueError if it is empty."""
    count = min(most, len(dataset))
    if count == 0:
        raise ValueError("the dataset is empty, so there is nothing to predict")
    return [n * len(dataset) // count for n in range(count)]


def _seconds_of(model: nn.Module, dataset: Any, index: int, device: torch.device | str) -> float:
    """Return the CPU time of a prediction."""
    began = time.process_time()
    batch, _ = collate([dataset[index]])
    model(batch.to(device))
    return time.process_time() - began


def validation(trainer: Trainer, dataset: Any) -> Callable[[int], dict[str, float]] | None:
    """Return the function by which `Trainer.fit` selects weights on a dataset; None without a dataset."""
    if dataset is None:
        return None
    batches = loader(dataset, trainer.batch, trainer.team, seed=trainer.seed, whole_batches=True)
    return lambda epoch: {VALIDATION: votes(trainer.model, batches, 1, trainer.team).single.value}
