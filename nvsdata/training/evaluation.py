"""Accuracy of a network on recordings, by single windows and by voting over windows."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from itertools import zip_longest
from statistics import median
from typing import Any

import torch
from torch import distributed, nn
from torch.utils.data import DataLoader

from nvsdata.data.batching import collate
from nvsdata.metrics.intervals import Accuracy, accuracy
from nvsdata.models.prediction import vote
from nvsdata.training.data import loader
from nvsdata.training.processes import Team
from nvsdata.training.trainer import VALIDATION, Trainer

TIMED = 100  # maximum number of windows whose prediction is timed


@torch.no_grad()
def predict(
    model: Callable[[Any], torch.Tensor], batches: DataLoader[Any], team: Team
) -> tuple[torch.Tensor, torch.Tensor]:
    """Compute a model's outputs for all batches in order.

    Args:
        model: Network or function that returns values [B, ...] of a batch.
        batches: Loader of `(inputs, targets)`.
        team: The processes that share each batch.

    Returns:
        Values [N, ...] and targets [N], the same in all processes.

    Example:
        >>> import torch
        >>> from nvsdata import training
        >>> batches = [(torch.tensor([[2.0, 0.0], [1.0, 0.0]]), torch.tensor([0, 1]))]
        >>> team = training.Team(torch.device("cpu"))
        >>> values, targets = training.predict(torch.nn.Identity(), batches, team)
        >>> values.shape, targets.tolist()
        (torch.Size([2, 2]), [0, 1])
    """
    if isinstance(model, nn.Module):
        model.eval()
    mine = [(model(inputs.to(team.device)).cpu(), targets) for inputs, targets in batches]
    everyone: list[Any] = [mine]
    if team.count > 1:
        everyone = [None] * team.count
        distributed.all_gather_object(everyone, mine)
    # the parts of a batch are in order of rank; some processes may have no part of the last batch
    pairs = [pair for shares in zip_longest(*everyone) for pair in shares if pair is not None]
    return torch.cat([given for given, _ in pairs]), torch.cat([targets for _, targets in pairs])


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
        batches: Loader of `rounds` x `windows` epochs, each with every recording once in the same order.
        windows: Number of windows that vote together.
        team: The processes that share each batch.
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
    count = min(TIMED, len(dataset))
    if count == 0:
        raise ValueError("the dataset is empty, so there is nothing to predict")
    model.eval()
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        times = [_seconds_of(model, dataset, n * len(dataset) // count, device) for n in range(count)]
    finally:
        torch.set_num_threads(threads)
    return 1e3 * median(times)


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
    batches = loader(dataset, trainer.batch, trainer.team, seed=trainer.seed)
    return lambda epoch: {VALIDATION: votes(trainer.model, batches, 1, trainer.team).single.value}
