"""What processes that train one model together must agree on, so that they do as one process would.

With torch.distributed, each process has a share of every batch, in order of rank. Statistics over a batch and
dropout are the only layers to which it matters; without it, these functions do nothing.
"""

from __future__ import annotations

from typing import Any

import torch
from torch import distributed, nn


def processes() -> int:
    """How many train together; 1 without torch.distributed."""
    return distributed.get_world_size() if distributed.is_available() and distributed.is_initialized() else 1


class _Total(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, x: torch.Tensor) -> torch.Tensor:
        total = x.clone()
        distributed.all_reduce(total)
        return total

    @staticmethod
    def backward(ctx: Any, gradient: torch.Tensor) -> torch.Tensor:
        # every process's loss depends on the total
        total = gradient.clone()
        distributed.all_reduce(total)
        return total


def all_reduce_sum(x: torch.Tensor) -> torch.Tensor:
    """Sum of `x` over all processes; differentiable."""
    return _Total.apply(x) if processes() > 1 else x  # type: ignore[no-untyped-call]


class Dropout(nn.Module):
    """Dropout whose mask is drawn for the whole batch and cut to the process's share of it.

    The processes' generators must have been seeded alike.
    """

    def __init__(self, p: float = 0.5) -> None:
        super().__init__()
        self.p = p

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """`x` [B, ...] with elements set to zero with probability `p`, the others divided by 1 - p."""
        if not self.training or self.p == 0:
            return x
        count, before = x.shape[0], 0
        if processes() > 1:
            counts = x.new_zeros(processes())
            counts[distributed.get_rank()] = count
            shares = [int(c) for c in all_reduce_sum(counts)]
            count, before = sum(shares), sum(shares[: distributed.get_rank()])
        mask = x.new_empty(count, *x.shape[1:]).bernoulli_(1 - self.p)
        return x * mask[before : before + x.shape[0]] / (1 - self.p)

    def extra_repr(self) -> str:
        return f"p={self.p}"
