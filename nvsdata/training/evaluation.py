"""What a network says of recordings, and how often it is right."""

from __future__ import annotations

from collections.abc import Callable
from itertools import zip_longest
from typing import Any

import torch
from torch import distributed, nn
from torch.utils.data import DataLoader

from nvsdata.models.voting import vote
from nvsdata.training.processes import Team


@torch.no_grad()
def predict(
    model: Callable[[Any], torch.Tensor], batches: DataLoader[Any], team: Team
) -> tuple[torch.Tensor, torch.Tensor]:
    """What a model gives for all batches, in order: values [N, ...] and targets [N], the same in all processes."""
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


def accuracies(
    model: Callable[[Any], torch.Tensor], batches: DataLoader[Any], windows: int, team: Team, rounds: int = 1
) -> tuple[float, float]:
    """Accuracy of one window (mean over all), and of the windows of a recording together; see `voting.vote`.

    - `model`: gives scores [B, num_classes]
    - `batches`: every recording once, then again, and so on, `rounds` times `windows` times
    - `windows`: how many vote together
    - `rounds`: votes per recording, over which accuracy is the mean (default 1)
    """
    scores, targets = predict(model, batches, team)
    voters = scores.view(rounds, windows, -1, scores.shape[1])
    wanted = targets.chunk(rounds * windows)[0]

    def share(named: torch.Tensor) -> float:
        # NaN names no class, although argmax gives one
        right = (named.argmax(-1) == wanted) & ~named.isnan().any(-1)
        return right.double().mean().item()

    return share(voters), share(vote(voters, 1))
