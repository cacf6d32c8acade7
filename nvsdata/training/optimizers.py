"""Optimizers with their schedules, as the thesis has them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import torch
from torch import nn


def sgd(
    model: nn.Module, rate: float, every: int, epochs: int, *, decay: float = 0.0, decayed: Sequence[nn.Module] = ()
) -> tuple[torch.optim.Optimizer, Any]:
    """Gradient descent with momentum 0.9, its rate decayed tenfold every `every` epochs, and weight decay.

    The weight decay is that of the layers `decayed`, if there are any, else of all.
    """
    optimizer = torch.optim.SGD(model.parameters(), lr=rate, momentum=0.9, weight_decay=decay)
    if decayed:
        held = {p for layer in decayed for p in layer.parameters()}
        groups = [{"params": [p for p in model.parameters() if p not in held], "weight_decay": 0.0}]
        groups += [{"params": [p for p in model.parameters() if p in held]}]
        optimizer = torch.optim.SGD(groups, lr=rate, momentum=0.9, weight_decay=decay)
    return optimizer, torch.optim.lr_scheduler.MultiStepLR(optimizer, list(range(every, epochs, every)))


def adam(model: nn.Module, epochs: int, milestones: tuple[int, int]) -> tuple[torch.optim.Optimizer, Any]:
    """Adam with a rate of 1e-3, decayed tenfold at `milestones` out of 150, stretched to `epochs`."""
    optimizer = torch.optim.Adam(model.parameters(), lr=1e-3, fused=True)
    at = [round(epochs * milestone / 150) for milestone in milestones]
    return optimizer, torch.optim.lr_scheduler.MultiStepLR(optimizer, at)
