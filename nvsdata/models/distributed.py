"""Functions and layers with which several processes train with the same results as a single process.

With torch.distributed, each process has a part of every batch, in order of rank. Only dropout and layers with
statistics over a batch depend on this. Without torch.distributed, they compute as in a single process.
"""

from __future__ import annotations

from typing import Any

import torch
from torch import distributed, nn


def process_count() -> int:
    """Return the number of processes that train together; 1 without torch.distributed."""
    return distributed.get_world_size() if distributed.is_available() and distributed.is_initialized() else 1


class _Total(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, x: torch.Tensor) -> torch.Tensor:
        total = x.clone()
        distributed.all_reduce(total)
        return total

    @staticmethod
    def backward(ctx: Any, gradient: torch.Tensor) -> torch.Tensor:
        # the loss of every process depends on the total
        total = gradient.clone()
        distributed.all_reduce(total)
        return total


def all_reduce_sum(x: torch.Tensor) -> torch.Tensor:
    """Return the differentiable sum of `x` over all processes."""
    return _Total.apply(x) if process_count() > 1 else x  # type: ignore[no-untyped-call]


class Dropout(nn.Module):
    """Dropout whose mask is sampled for the entire batch and cut to the part of this process.

    The generators of all processes must have the same seed.
    """

    def __init__(self, p: float = 0.5) -> None:
        super().__init__()
        self.p = p

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """Set elements of `x` [B, ...] to 0 with probability `p`, and divide the others by 1 - p."""
        if not self.training or self.p == 0:
            return x
        count, before = x.shape[0], 0
        if process_count() > 1:
            counts = x.new_zeros(process_count())
            counts[distributed.get_rank()] = count
            shares = [int(c) for c in all_reduce_sum(counts)]
            count, before = sum(shares), sum(shares[: distributed.get_rank()])
        mask = x.new_empty(count, *x.shape[1:]).bernoulli_(1 - self.p)
        return x * mask[before : before + x.shape[0]] / (1 - self.p)

    def extra_repr(self) -> str:
        return f"p={self.p}"
