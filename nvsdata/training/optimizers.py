"""Optimizers with schedules that step once per epoch: those of the thesis, and one cycle."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import torch
from torch import nn

RISE = 0.3  # fraction of the epochs in which the rate of a cycle rises


def sgd(
    model: nn.Module, rate: float, every: int, epochs: int, *, decay: float = 0.0, decayed: Sequence[nn.Module] = ()
) -> tuple[torch.optim.Optimizer, Any]:
    """Build gradient descent with momentum 0.9, and a schedule.

    Args:
        model: The network.
        rate: Initial learning rate.
        every: Number of epochs after which the rate is divided by 10, each time.
        epochs: Number of epochs.
        decay: Weight decay (default 0.0).
        decayed: Layers with weight decay (default: all).

    Returns:
        Optimizer and schedule.

    Example:
        >>> import torch
        >>> from nvsdata import training
        >>> optimizer, schedule = training.sgd(torch.nn.Linear(2, 1), 0.01, 50, 150)
        >>> schedule.get_last_lr()
        [0.01]
    """
    held = {p for layer in decayed or (model,) for p in layer.parameters()}
    groups: list[dict[str, Any]] = [{"params": [p for p in model.parameters() if p in held]}]
    if free := [p for p in model.parameters() if p not in held]:
        groups.insert(0, {"params": free, "weight_decay": 0.0})
    optimizer = torch.optim.SGD(groups, lr=rate, momentum=0.9, weight_decay=decay)
    return optimizer, torch.optim.lr_scheduler.MultiStepLR(optimizer, list(range(every, epochs, every)))


def adam(model: nn.Module, epochs: int, milestones: tuple[int, int]) -> tuple[torch.optim.Optimizer, Any]:
    """Build Adam with a rate of 1e-3, and a schedule.

    Args:
        model: The network.
        epochs: Number of epochs.
        milestones: Epochs out of 150 after which the rate is divided by 10, scaled to `epochs`.

    Returns:
        Optimizer and schedule.

    Example:
        >>> import torch
        >>> from nvsdata import training
        >>> optimizer, schedule = training.adam(torch.nn.Linear(2, 1), 150, (60, 110))
        >>> schedule.get_last_lr()
        [0.001]
    """
    optimizer = torch.optim.Adam(model.parameters(), lr=1e-3, fused=True)
    at = [round(epochs * milestone / 150) for milestone in milestones]
    return optimizer, torch.optim.lr_scheduler.MultiStepLR(optimizer, at)


def one_cycle(model: nn.Module, epochs: int, rate: float = 3e-3) -> tuple[torch.optim.Optimizer, Any]:
    """Return Adam with a rate that rises to `rate` in 30% of `epochs`, then falls to about 0 (Smith and Topin 2019)."""

    def share(epoch: int) -> float:
        done = min((epoch + 0.5) / epochs, 1.0)
        if done < RISE:
            return 0.04 + 0.96 * (1 - math.cos(math.pi * done / RISE)) / 2
        return (1 + math.cos(math.pi * (done - RISE) / (1 - RISE))) / 2

    optimizer = torch.optim.Adam(model.parameters(), lr=rate, fused=True)
    return optimizer, torch.optim.lr_scheduler.LambdaLR(optimizer, share)
