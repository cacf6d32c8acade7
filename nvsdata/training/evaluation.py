"""Predictions of a network for recordings, and their accuracy."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import zip_longest
from typing import Any

import torch
from torch import distributed, nn
from torch.utils.data import DataLoader

from nvsdata.models.prediction import vote
from nvsdata.training.processes import Team


@torch.no_grad()
def predict(
    model: Callable[[Any], torch.Tensor], batches: DataLoader[Any], team: Team
) -> tuple[torch.Tensor, torch.Tensor]:
    """Return a model's outputs for all batches in order: values [N, ...] and targets [N], the same in all processes."""
    if isinstance(model, nn.Module):
        model.eval()
    mine = [(model(inputs.to(team.device)).cpu(), targets) for inputs, targets in batches]
    everyone: list[Any] = [mine]
    if team.count > 1:
        everyone = [None] * team.count
        distributed.all_gather_object(everyone, mine)
    # a batch's shares lie in order of rank; the last batch may have none for some
    pairs = [pair for shares in zip_longest(*everyone) for pair in shares if pair is not None]
    return torch.cat([given for given, _ in pairs]), torch.cat([targets for _, targets in pairs])


def share_right(scores: torch.Tensor, targets: torch.Tensor) -> float:
    """Share of scores [..., num_classes] that are highest for the true classes, of a shape that goes with [...]."""
    # NaN names no class, although argmax gives one
    right = (scores.argmax(-1) == targets) & ~scores.isnan().any(-1)
    return right.double().mean().item()


@dataclass(frozen=True)
class Votes:
    """Predictions of a network for windows of recordings.

    - `voters`: log-probabilities [rounds, windows, N, num_classes]; the windows of a round vote together; see `vote`
    - `targets`: true classes [N]
    """

    voters: torch.Tensor
    targets: torch.Tensor

    @property
    def single(self) -> float:
        """Accuracy of one window, the mean over all."""
        return share_right(self.voters, self.targets)

    @property
    def together(self) -> float:
        """Accuracy of the votes, the mean over all rounds."""
        return share_right(vote(self.voters, 1), self.targets)


def votes(
    model: Callable[[Any], torch.Tensor], batches: DataLoader[Any], windows: int, team: Team, rounds: int = 1
) -> Votes:
    """Return a model's predictions for each window of each recording.

    - `model`: gives scores [B, num_classes]
    - `batches`: every recording once, then again, and so on, `rounds` times `windows` times
    - `windows`: how many vote together
    - `rounds`: votes per recording (default 1)
    """
    scores, targets = predict(model, batches, team)
    voters = scores.log_softmax(1).view(rounds, windows, -1, scores.shape[1])
    return Votes(voters, targets.chunk(rounds * windows)[0])


def accuracies(
    model: Callable[[Any], torch.Tensor], batches: DataLoader[Any], windows: int, team: Team, rounds: int = 1
) -> tuple[float, float]:
    """Accuracy of one window (mean over all), and of the windows of a recording together; see `votes`."""
    given = votes(model, batches, windows, team, rounds)
    return given.single, given.together
