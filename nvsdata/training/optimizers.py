"""Optimizers with their schedules, which step once per epoch: the thesis's, and a cycle."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import torch
from torch import nn

RISE = 0.3  # share of the epochs in which the rate of a cycle rises


def sgd(
    model: nn.Module, rate: float, every: int, epochs: int, *, decay: float = 0.0, decayed: Sequence[nn.Module] = ()
) -> tuple[torch.optim.Optimizer, Any]:
    """Gradient descent with momentum 0.9, its rate decayed tenfold every `every` epochs, and weight decay.

    The weight decay is that of the layers `decayed`, if there are any, else of all.
    """
    held = {p for layer in decayed or (model,) for p in layer.parameters()}
    groups: list[dict[str, Any]] = [{"params": [p for p in model.parameters() if p in held]}]
    if free := [p for p in model.parameters() if p not in held]:
        groups.insert(0, {"params": free, "weight_decay": 0.0})
    optimizer = torch.optim.SGD(groups, lr=rate, momentum=0.9, weight_decay=decay)
    return optimizer, torch.optim.lr_scheduler.MultiStepLR(optimizer, list(range(every, epochs, every)))


def adam(model: nn.Module, epochs: int, milestones: tuple[int, int]) -> tuple[torch.optim.Optimizer, Any]:
    """Adam with a rate of 1e-3, decayed tenfold at `milestones` out of 150, stretched to `epochs`."""
    optimizer = torch.optim.Adam(model.parameters(), lr=1e-3, fused=True)
    at = [round(epochs * milestone / 150) for milestone in milestones]
    return optimizer, torch.optim.lr_scheduler.MultiStepLR(optimizer, at)


def one_cycle(model: nn.Module, epochs: int, rate: float = 3e-3) -> tuple[torch.optim.Optimizer, Any]:
    """Adam with a rate that rises to `rate` over 30% of `epochs`, then falls to almost 0 (Smith and Topin 2019)."""

    def share(epoch: int) -> float:
        done = min((epoch + 0.5) / epochs, 1.0)
        if done < RISE:
            return 0.04 + 0.96 * (1 - math.cos(math.pi * done / RISE)) / 2
        return (1 + math.cos(math.pi * (done - RISE) / (1 - RISE))) / 2

    optimizer = torch.optim.Adam(model.parameters(), lr=rate, fused=True)
    return optimizer, torch.optim.lr_scheduler.LambdaLR(optimizer, share)
